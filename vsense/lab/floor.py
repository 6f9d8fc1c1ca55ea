"""The lab's floor as the host's side sees it: starts the `atoms` process and ends it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from vsense.config.specs import Experiment, ObjectSpec, RobotSpec
from vsense.lab.links import bases_of
from vsense.lab.processes import describe_exit, end
from vsense.lab.shared import LabError
from vsense.physics.motion import obstacles

_BOX = ("x_m", "y_m", "yaw_rad", "size_x_m", "size_y_m")
_CYLINDER = ("x_m", "y_m", "radius_m")


class FloorProcess:
    """The running `atoms` process: true physics, and a microcontroller for each robot.

    Attributes:
        bases: what the robots' daemons find their bases at, in the experiment's order.
        log: where every applied motor command is noted.
    """

    def __init__(
        self,
        experiment: Experiment,
        truth: str,
        seed: int,
        directory: Path,
        base: str,
    ) -> None:
        """Puts robots, objects and walls in their places.

        Args:
            experiment: what stands in the arena; it is settled.
            truth: name of the truth ring.
            seed: seed of the proximity sensors' noise.
            directory: where the log goes.
            base: what the robots are based on, of `vsense.lab.links.BASES`.

        Raises:
            LabError: the process cannot do its work.
        """
        self.log = directory / "actuations.bin"
        self._process = subprocess.Popen(
            [sys.executable, "-m", "vsense.lab.physics_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        spec = _spec(experiment, truth, seed, self.log)
        spec["bases"] = bases_of(base, len(experiment.robots))
        self.bases: list[str] = json.loads(self._ask(spec))["bases"]

    def check(self) -> None:
        """Raises LabError where the process has ended by itself."""
        if self._process.poll() is not None:
            raise LabError(f"the lab's physics {describe_exit(self._process.returncode)}")

    def close(self) -> None:
        """Ends the process; its log is complete then."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        end(self._process)
        self._process.stdout.close()

    def _ask(self, spec: Mapping[str, object]) -> bytes:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(spec).encode() + b"\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            self._process.wait()
            raise LabError("the lab's physics did not start; the reason stands above")
        return answer


def _spec(experiment: Experiment, truth: str, seed: int, log: Path) -> dict[str, object]:
    """What the process is told; see `vsense.lab.physics_process`."""
    boxes, cylinders = obstacles(experiment.boxes, experiment.cylinders)
    return {
        "robots": [
            {"index": i, "tag": robot.tag, **_pose(robot)}
            for i, robot in enumerate(experiment.robots)
        ],
        "objects": [{"tag": thing.tag, **_pose(thing)} for thing in experiment.objects],
        "boxes": [dict(zip(_BOX, box)) for box in boxes.tolist()],
        "cylinders": [dict(zip(_CYLINDER, cylinder)) for cylinder in cylinders.tolist()],
        "truth": truth,
        "log": str(log),
        "directory": str(log.parent),
        "seed": seed,
    }


def _pose(body: RobotSpec | ObjectSpec) -> dict[str, float]:
    assert body.pose is not None
    return body.pose._asdict()
