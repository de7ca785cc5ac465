from .automatic_confidence import AutomaticConfidence as AutomaticConfidence
from .automatic_confidence import JudgedMaps as JudgedMaps
from .map_fault import FaultLog as FaultLog
from .map_fault import MapFault as MapFault
from .map_fault import MapFindings as MapFindings
from .pixel_links import PixelLinks as PixelLinks
