from .config import EncoderConfig as EncoderConfig
from .config import MapsConfig as MapsConfig
from .config import NetworkConfig as NetworkConfig
from .loss import map_errors as map_errors
from .loss import masked_l1 as masked_l1
from .model import TransferModel as TransferModel
from .prediction import Prediction as Prediction
from .transfer import TransferNet as TransferNet
