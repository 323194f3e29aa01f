"""A step of a pelagos-py pipeline that estimates depth-averaged currents (docs/light-currents.md)."""

from typing import Any

from pelagos_py.steps import STEP_CLASSES
from pelagos_py.steps.base_step import BaseStep, register_step

import gliderhpc as gh


@register_step
class DepthAveragedCurrents(BaseStep):
    """Estimate the currents of the pipeline's data.

    Parameters of the step: ``output_path``, the netCDF file to write, and optionally ``platform``, a hull's name or
    file, and ``declination`` (degree), which is added to a magnetic heading instead of the one in the file.
    """

    step_name = "Depth-averaged currents"

    def run(self) -> dict[str, Any]:
        """Add the currents to the context under ``currents``."""
        self.check_data()
        given = self.parameters
        if "output_path" not in given:
            raise ValueError(f"step {self.name}: give output_path, the netCDF file to write")
        found = gh.currents(self.context["data"], platform=given.get("platform"), declination=given.get("declination"))
        found.to_netcdf(given["output_path"])
        self.context["currents"] = found
        self.log(f"{found.sizes['profile']} profiles, {int(found['dac_north'].notnull().sum())} with a current")
        return self.context


STEP_CLASSES[DepthAveragedCurrents.step_name] = DepthAveragedCurrents
