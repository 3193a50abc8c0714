"""How a wheel is built: with hatchling, and with the models of the linear loop as Python modules.

An editable install translates the models on first use and must not download the tools for it beforehand.
Hatchling asks for the requirements of its build hooks in both cases alike; therefore this module stands
before it as build backend and adds them for wheels only. It is the build hook as well.
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
TOOLS = {"numpy", "pint", "platformdirs", "pydantic", "rumoca", "scipy", "sympy"}


def get_requires_for_build_wheel(config_settings: object = None) -> list[str]:  # noqa: ARG001
    """Name the tools that translate the models."""
    from hatchling.builders.wheel import WheelBuilder
    from packaging.requirements import Requirement

    core = WheelBuilder(str(ROOT)).metadata.core
    offered = [*core.dependencies, *core.optional_dependencies["build"]]
    return [text for text in offered if Requirement(text).name.lower() in TOOLS]


class GeneratedModules(BuildHookInterface):
    """Puts ``lpfcosim/modelica/generated`` and the quick start into a wheel; the checkout stays as it is."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Translate the models, unless the install is editable."""
        if version != "standard":
            return
        sys.path.insert(0, str(ROOT))
        from lpfcosim.errors import InputError

        self._folder = tempfile.TemporaryDirectory(prefix="lpfcosim-")
        try:
            from lpfcosim.modelica import numpy_models
            from lpfcosim.models import fmu_names

            numpy_models.write_shipped(Path(self._folder.name), fmu_names())
        except ImportError as error:
            self.app.abort(f"The models cannot be translated: {error}; install the build extra first")
        except InputError as error:
            self.app.abort(str(error))
        build_data["force_include"][self._folder.name] = "lpfcosim/modelica/generated"
        build_data["force_include"][str(ROOT / "campaigns" / "quickstart.toml")] = (
            "lpfcosim/campaign/quickstart.toml"
        )

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove the modules; the wheel holds them now."""
        if version == "standard":
            self._folder.cleanup()
