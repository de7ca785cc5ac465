from .config import AnchorDefConfig as AnchorDefConfig
from .method import AnchorDef as AnchorDef
