"""Settings of the study ``nulls``."""

from pydantic import Field

from gliderhpc.estimation.settings import Settings
from gliderhpc.studies.library.turbulence.settings import IntermittencySettings


class NullSettings(Settings):
    """How many nulls of which kind, and by what they are judged."""

    noise_only: int = Field(12, ge=0, description="realisations of the known hull with sensor noise alone")
    model_error: int = Field(12, ge=0, description="realisations of hulls whose coefficients are drawn")
    gaussian: int = Field(12, ge=0, description="realisations with a Gaussian disturbance of the measured spectrum")
    spread: float = Field(0.15, ge=0, lt=1, description="largest relative error of a coefficient that is drawn")
    seed: int = Field(0, ge=0, description="of all draws")
    statistics: IntermittencySettings = IntermittencySettings()

    @property
    def families(self) -> dict[str, int]:
        """Realisations of each kind."""
        return {"noise_only": self.noise_only, "model_error": self.model_error, "gaussian": self.gaussian}
