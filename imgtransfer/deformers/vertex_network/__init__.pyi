from .method import GraphNetwork as GraphNetwork
from .method import PointNet as PointNet
