"""The transfer networks: encoder, refinement, decoder, the body-based first guess, and both networks as one
model.
"""

from imgtransfer.network.config import EncoderConfig as EncoderConfig
from imgtransfer.network.config import MapsConfig as MapsConfig
from imgtransfer.network.config import NetworkConfig as NetworkConfig
from imgtransfer.network.loss import masked_l1 as masked_l1
from imgtransfer.network.model import Prediction as Prediction
from imgtransfer.network.model import TransferModel as TransferModel
from imgtransfer.network.transfer import TransferNet as TransferNet
