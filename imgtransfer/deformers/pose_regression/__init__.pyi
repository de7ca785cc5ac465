from .method import PoseRegression as PoseRegression
from .method import PoseRegressionConfig as PoseRegressionConfig
