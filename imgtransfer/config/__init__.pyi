from .loader import load_config as load_config
