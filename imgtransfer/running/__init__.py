"""Independent tasks on this process, on a pool of processes, or on a Ray cluster: one interface.

    run = run_tasks(function, tasks, executor=executor_for(workers=4), name=lambda task: task.name)

`function` writes its own results whole or not at all, and begins by looking whether they stand already: a task may be
started more than once, where the process or machine that did it died.
"""

from imgtransfer.running.cluster import Cluster as Cluster
from imgtransfer.running.pool import Pool as Pool
from imgtransfer.running.runner import Run as Run
from imgtransfer.running.runner import executor_for as executor_for
from imgtransfer.running.runner import run_tasks as run_tasks
from imgtransfer.running.task import Executor as Executor
from imgtransfer.running.task import Outcome as Outcome
from imgtransfer.running.task import Serial as Serial
from imgtransfer.running.task import in_worker as in_worker
