from .reading import load_pickle as load_pickle
from .smpl_models import load_model_pickle as load_model_pickle
