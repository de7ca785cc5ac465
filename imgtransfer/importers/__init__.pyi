from .job import ImportOptions as ImportOptions
from .job import Job as Job
from .job import run_jobs as run_jobs
from .smpl import SmplModel as SmplModel
from .smpl import find_smpl as find_smpl
from .smpl import smpl_body as smpl_body
