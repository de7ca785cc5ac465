from .checkpoint import fingerprint as fingerprint
from .checkpoint import load_model as load_model
from .checkpoint import save_model as save_model
from .config import RunConfig as RunConfig
from .hub import from_pretrained as from_pretrained
from .hub import save_pretrained as save_pretrained
from .loop import train as train
from .trainer import Trainer as Trainer
