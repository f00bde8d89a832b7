"""Where the parts of a computation are worked on: here, in processes beside, in any executor, on a Dask cluster."""

from posture_opt.workers.executors import ExecutorWorkers
from posture_opt.workers.opened import Executor, opened
from posture_opt.workers.processes import ProcessWorkers
from posture_opt.workers.serial import Serial
from posture_opt.workers.workers import Part, Workers

__all__ = ["Executor", "ExecutorWorkers", "Part", "ProcessWorkers", "Serial", "Workers", "opened"]
