from .check import motion_faults as motion_faults
from .files import load_motion as load_motion
from .files import read_motion as read_motion
from .library import make_motion as make_motion
from .motion import Motion as Motion
from .motion import arms_out as arms_out
from .motion import resample as resample
from .summary import MotionSummary as MotionSummary
