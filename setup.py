"""What pyproject.toml cannot say: the C library, the host's `vsensed`, the sources of the robot,
and the README as an index shows it.

The wheel carries, beside the Python package:
* `vsense/_native.abi3.so` and `vsense/_kernels.abi3.so`, the C libraries behind cffi;
* `vsense/_sources/`, the C sources from which a user's controller is built later, without
  `c_src/host/`, which no robot runs; and the pages that lie outside of `vsense/`;
* `vsense/_sources/bin/vsensed`, the daemon for the wheel's machine with the shipped controller.
An editable install and a checkout use the checkout's own folders (`vsense/robots/build.py`).

`scripts/release` sets two variables: VSENSE_STATIC has the daemon built by the pinned compiler, so
that it runs on every Linux; VSENSE_URL is where the sources are published, for the links.
"""

import os
import platform
import shutil
import sys
import sysconfig
from dataclasses import replace
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
sys.path.insert(0, str(ROOT))

from vsense import __version__  # noqa: E402
from vsense.robots import boards, build, sources  # noqa: E402
from vsense.robots.compiling import HOST_FLAGS  # noqa: E402
from vsense.tools.shipped import documents  # noqa: E402

URL = os.environ.get("VSENSE_URL", "").rstrip("/")

SOURCES = {
    "": ("README.md", "CHANGELOG.md"),
    "c_src": ("*.c", "*.h", "*.md"),
    "robot": ("**/*.c", "**/*.cpp", "**/*.h", "**/*.hpp", "**/*.txt", "**/*.md", "**/*.py"),
    "firmware_bridge": ("*.c", "*.h", "*.md"),
    "tests": ("README.md", "fuzz/README.md"),
}
"""What goes along of each folder beside `vsense/`."""


class BuildWithSources(build_py):
    """Adds the robot's C sources, the daemon built from them, and the pages to the package."""

    def run(self):
        super().run()
        if self.editable_mode:
            return
        target = Path(self.build_lib) / "vsense" / "_sources"
        for folder, patterns in SOURCES.items():
            for source in sorted(p for pattern in patterns for p in (ROOT / folder).glob(pattern)):
                copy = target / source.relative_to(ROOT)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(source, copy)
        if commit := sources.commit():
            (target / sources.COMMIT).write_text(commit)
        compile_daemon(build.SourceTree(target))


def compile_daemon(tree):
    """Compiles the daemon for the machine that the wheel is for."""
    machine = sysconfig.get_platform().rpartition("-")[2]
    program = tree.program(build.SHIPPED_CONTROLLER)
    if "VSENSE_STATIC" in os.environ:
        target = boards.TARGETS["host" if machine == platform.machine() else machine]
        compiler = boards.toolchain(target, build.cache_directory())
        compiler = replace(compiler, flags=(*compiler.flags, *HOST_FLAGS))
        tree.daemon(program, plain=True).link_daemon(compiler, tree.prebuilt)
    else:
        build.compile_daemon(tree, program, tree.prebuilt)


setup(
    cffi_modules=["c_src/build_ffi.py:native", "c_src/build_ffi.py:kernels"],
    cmdclass={"build_py": BuildWithSources},
    options={"bdist_wheel": {"py_limited_api": "cp310"}},
    long_description=documents.published(ROOT / "README.md", URL, __version__),
    long_description_content_type="text/markdown",
    project_urls={
        "Source": URL,
        "Documentation": f"{URL}/blob/v{__version__}/README.md",
        "Changelog": f"{URL}/blob/v{__version__}/CHANGELOG.md",
        "Issues": f"{URL}/issues",
    }
    if URL
    else {},
)
