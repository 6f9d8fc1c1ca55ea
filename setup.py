"""What pyproject.toml cannot say: the C library, the host's `vsensed`, the sources of the robot.

The wheel carries, beside the Python package:
* `vsense/_native.abi3.so` and `vsense/_kernels.abi3.so`, the C libraries behind cffi;
* `vsense/_sources/`, the C sources from which a user's controller is built later, without
  `c_src/host/`, which no robot runs;
* `vsense/_sources/bin/vsensed`, the daemon for this machine with the shipped controller.
An editable install and a checkout use the checkout's own folders (`vsense/robot/build.py`).
"""

import shutil
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent


class BuildWithSources(build_py):
    """Adds the robot's C sources and the daemon built from them to the package."""

    def run(self):
        super().run()
        if self.editable_mode:
            return
        target = Path(self.build_lib) / "vsense" / "_sources"
        for folder in ("c_src", "robot", "firmware_bridge"):
            for source in sorted((ROOT / folder).rglob("*")):
                if (
                    source.suffix in (".c", ".cpp", ".h", ".hpp", ".txt", ".md")
                    and source.parent.name != "host"
                ):
                    copy = target / source.relative_to(ROOT)
                    copy.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(source, copy)
        sys.path.insert(0, str(ROOT))
        from vsense.doctor import versions
        from vsense.robot import build

        if commit := versions.commit():
            (target / versions.COMMIT).write_text(commit)
        tree = build.SourceTree(target)
        build.compile_daemon(tree, tree.program("pollutant"), tree.prebuilt)


setup(
    cffi_modules=["c_src/build_ffi.py:native", "c_src/build_ffi.py:kernels"],
    cmdclass={"build_py": BuildWithSources},
    options={"bdist_wheel": {"py_limited_api": "cp310"}},
)
