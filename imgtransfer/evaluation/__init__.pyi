from .inspection import Inspection as Inspection
from .inspection import inspect_clip as inspect_clip
from .metrics import METRICS as METRICS
from .metrics import evaluate_clip as evaluate_clip
from .skinning import lbs_baseline as lbs_baseline
from .summary import summarise as summarise
from .table import metrics_json as metrics_json
from .table import metrics_table as metrics_table
