from .commented import commented_yaml as commented_yaml
from .loader import load_config as load_config
from .loader import parse_config as parse_config
from .loader import to_yaml as to_yaml
from .schema import Section as Section
