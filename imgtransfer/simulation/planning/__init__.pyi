from .job import simulate as simulate
from .sources import sorted_sources as sorted_sources
