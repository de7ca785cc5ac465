from .method import ImageTransfer as ImageTransfer
from .method import ImageTransferConfig as ImageTransferConfig
