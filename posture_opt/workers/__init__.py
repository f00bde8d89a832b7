"""Where the parts of a computation are worked on: here, in other processes, in any executor, on a Dask cluster."""

from posture_opt.workers.chosen_workers import Executor, opened
from posture_opt.workers.serial import Serial
from posture_opt.workers.workers import Part, Workers

__all__ = ["Executor", "Part", "Serial", "Workers", "opened"]
