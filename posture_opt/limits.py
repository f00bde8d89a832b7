"""All limits in one place: how much the commands accept, what one thing more costs, and what to do with too many.

No accepted input takes more than about ten minutes of one core, or 1 GB, on an arm with six joints, on which costs were
measured; a map of 50 000 targets takes twenty minutes, and goes on where it was ended.
"""

from __future__ import annotations

from dataclasses import dataclass

from posture_opt.errors import BadValueError, InputError, Issue, KeyPath


@dataclass(frozen=True)
class Budget:
    """The most of one thing that is accepted, where, what one costs as measured, and what to do with more.

    Example:
        >>> Budget("rows", 2, "tables", "1 ms each", "thin them out").check(3)
        Traceback (most recent call last):
        posture_opt.errors.BadValueError: 3 rows are more than the 2 that are accepted; thin them out
    """

    what: str
    most: int
    where: str
    cost: str
    hint: str

    def message(self, count: int) -> str:
        """What is wrong with ``count`` of them."""
        return f"{count} {self.what} are more than the {self.most} that are accepted"

    @property
    def beyond(self) -> str:
        """What is wrong where they are not counted to the end."""
        return f"more than the {self.most} {self.what} that are accepted"

    def check(self, count: int) -> None:
        """Refuse more of them, where the key is not known."""
        if count > self.most:
            raise BadValueError(self.message(count), self.hint)

    def check_at(self, count: int, key: KeyPath, hint: str = "") -> None:
        """Refuse more of them, named by ``key``; ``hint`` in place of the usual one."""
        if count > self.most:
            raise InputError(Issue(self.message(count), key, count, hint or self.hint))

    def rows(self, most: int, joints: int) -> int:
        """How many rows are used where ``most`` are asked for and rows times joints are limited."""
        return max(min(most, self.most // joints), 1)


MOST_JOINTS = Budget("joints", 20, "every robot", "all else grows with them", "leave out those that stand still")
MOST_CAPSULES = Budget("capsules", 100, "`robot.shape`", "0.1 s, 5 MB", "put several into one")
MOST_OBSTACLES = Budget("obstacles", 1000, "`cell.obstacles`", "10 ms, 0.2 MB", "leave out what is out of reach")
MOST_EFFECTS = Budget("effects", 200, "`effects`", "5 ms", "leave out those that do not matter")
MOST_FEATURES = Budget("features", 30, "`task.features`", "0.3 s, all are placed together", "split the task")
MOST_PATH_POINTS = Budget("points", 10_000, "a path, with those that `spacing` adds", "6 ms, 80 kB", "thin them out")
MOST_STARTS = Budget("starts", 10_000, "`solver.starts`", "10 ms", "take fewer: 500 find nearly all there is")
MOST_MAP_TARGETS = Budget("targets", 50_000, "`map`", "25 ms", "map a part of the box at a time")
MOST_SAMPLES = Budget("samples", 100_000_000, "`simulate`", "0.6 µs", "take fewer: 2e6 fix a variance to 0.1 %")
MOST_PROBLEM_FILES = Budget("problems", 10_000, "`batch`", "a solve each", "make several calls")
MOST_CELLS = Budget("cells", 10_000_000, "tables, rows times columns", "2.5 µs, 65 bytes", "leave out columns or rows")
MOST_FITTED = Budget("rows times joints", 600_000, "`calibrate`", "0.1 ms, 1 kB", "larger files are thinned to this")
MOST_SEARCHED = Budget("rows times joints", 60_000, "`diagnose`", "1 ms, 15 kB", "larger files are thinned to this")
MOST_PLACES = Budget(
    "places", 100, "columns `target`, `point`, `plane`, `anchor`",
    "100 take 85 s: three unknowns each, found again in every fold", "calibrate with some of them",
)  # fmt: skip
MOST_ROBOTS = Budget("robots", 500, "the column `robot`", "a calibration each", "make several files")
MOST_FOLDS = Budget("folds", 200, "`--folds`", "a fit each", "take fewer: 5 to 20 are usual")
MOST_PLANNED = Budget("postures", 200, "`plan-measurements --count`", "0.1 s, 2 MB", "make several plans")
MOST_CANDIDATES = Budget("candidates", 50_000, "`plan-measurements --candidates`", "0.3 ms, 4 kB", "take fewer")
MOST_COMPENSATED = Budget("targets", 50_000, "`compensate`", "5 ms, 3 kB", "make several files")
MOST_PIXELS = Budget("pixels", 25_000_000, "a picture of `detect`", "0.5 µs, up to 200 bytes", "scale it down")
MOST_BOARD_POINTS = Budget("points", 2_500, "`detect --board`", "less than a picture's pixels", "is it columns x rows?")

# All of them, as the reference lists them.
LIMITS: tuple[Budget, ...] = (
    MOST_JOINTS, MOST_CAPSULES, MOST_OBSTACLES, MOST_EFFECTS, MOST_FEATURES, MOST_PATH_POINTS, MOST_STARTS,
    MOST_MAP_TARGETS, MOST_SAMPLES, MOST_PROBLEM_FILES, MOST_CELLS, MOST_FITTED, MOST_SEARCHED, MOST_PLACES,
    MOST_ROBOTS, MOST_FOLDS, MOST_PLANNED, MOST_CANDIDATES, MOST_COMPENSATED,
    MOST_PIXELS, MOST_BOARD_POINTS,
)  # fmt: skip

# Largest files [bytes].
MAX_URDF_BYTES = 50_000_000  # a robot of some hundred links takes a few hundred kB
MAX_TABLE_BYTES = 2_000_000_000  # ten million rows of 200 characters
MAX_YAML_BYTES = 1_000_000  # the largest problem file written by hand has some thousand
