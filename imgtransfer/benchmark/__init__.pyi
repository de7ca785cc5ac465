from .config import BenchmarkConfig as BenchmarkConfig
from .run import run_benchmark as run_benchmark
from .tables import overall_table as overall_table
