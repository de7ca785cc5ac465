from .checkpoint import fingerprint as fingerprint
from .checkpoint import load_model as load_model
from .checkpoint import save_model as save_model
from .config import RunConfig as RunConfig
from .loop import train as train
from .trainer import Trainer as Trainer
