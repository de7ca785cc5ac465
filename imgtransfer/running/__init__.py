"""Independent tasks on this process, on a pool of processes, or on a Ray cluster: one interface.

    run = run_tasks(function, tasks, executor=executor_for(workers=4), name=lambda task: task.name)

`function` writes its own results whole or not at all, and begins by looking whether they stand already: a task may be
started more than once, where the process or machine that did it died.
"""

import lazy_loader

# The surface stands in the stub beside this file; a name is loaded when it is first asked for, because PyTorch
# takes seconds, for which neither `imgtransfer --help` nor an early Ctrl-C should wait.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
