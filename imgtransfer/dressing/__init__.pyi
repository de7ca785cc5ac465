from .deformed import Deformed as Deformed
from .deformed import deformed as deformed
from .figure import figure_of as figure_of
from .simulated import simulated as simulated
from .source import Source as Source
from .source import open_source as open_source
