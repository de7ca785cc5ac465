from .deformed import Deformed as Deformed
from .deformed import predict_and_fuse as predict_and_fuse
from .figure import figure_of as figure_of
from .simulated import simulate_source as simulate_source
from .source import Source as Source
from .source import open_source as open_source
