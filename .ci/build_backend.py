"""How a wheel is built: with hatchling, and with the FMUs ready made for every platform.

An editable install builds the FMUs on first use and must not download the tools for it beforehand. Hatchling
asks for the requirements of its build hooks in both cases alike; therefore this module stands before it as
build backend and adds them for wheels only. It is the build hook as well.
"""

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

# With this set hatchling hides how to prepare metadata, and pip would build the wheel twice.
os.environ.pop("PIP_BUILD_TRACKER", None)

from hatchling.build import *  # noqa: F403
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).parents[1]
# What the generator imports, of the requirements in pyproject.toml.
TOOLS = {"fmpy", "numpy", "pint", "platformdirs", "rumoca", "scipy", "sympy", "ziglang"}


def get_requires_for_build_wheel(config_settings: object = None) -> list[str]:  # noqa: ARG001
    """Name the tools that make FMUs."""
    from hatchling.builders.wheel import WheelBuilder
    from packaging.requirements import Requirement

    core = WheelBuilder(str(ROOT)).metadata.core
    offered = [*core.dependencies, *core.optional_dependencies["build"]]
    return [text for text in offered if Requirement(text).name.lower() in TOOLS]


class ReadyMade(BuildHookInterface):
    """Puts ``lpfcosim/prebuilt`` and the quick start into a wheel; the checkout stays as it is."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the FMUs and the stepping loop for all platforms, unless the install is editable."""
        if version != "standard":
            return
        sys.path.insert(0, str(ROOT))
        from lpfcosim.errors import InputError, RunError

        self._folder = tempfile.TemporaryDirectory(prefix="lpfcosim-")
        self.app.display_info("Building FMUs for all platforms; the first time this takes some minutes")
        try:
            from lpfcosim.modelica import build, numpy_models
            from lpfcosim.models import fmu_names

            folder, models = Path(self._folder.name), fmu_names()
            build.prebuild(folder, self.metadata.version, numpy_models.prebuild(folder, models), models)
        except ImportError as error:
            self.app.abort(f"The FMUs of the wheel cannot be built: {error}; install the build extra first")
        except (InputError, RunError) as error:
            self.app.abort(str(error))
        build_data["force_include"][self._folder.name] = "lpfcosim/prebuilt"
        build_data["force_include"][str(ROOT / "campaigns" / "quickstart.toml")] = (
            "lpfcosim/campaign/quickstart.toml"
        )

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove what was built; the wheel holds it now."""
        if version == "standard":
            self._folder.cleanup()
