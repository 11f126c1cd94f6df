"""Drive hysteresis: what the drive gives lags behind the command, as in a piezo (Prandtl–Ishlinskii)."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0..3] values of the stop operators, s[4] the last command
    change = signal - s[4]
    s[4] = signal
    reach = p[4]
    lag = 0.0
    for i in range(4):
        s[i] = min(max(s[i] + change, -reach), reach)
        lag -= p[i] * s[i]
        reach /= 3.0
    return lag


@dataclass(frozen=True)
class DriveHysteresis(Effect):
    """Command less sum weight_i · z_i: stop operator z_i follows the command within ±reach / 3^(i-1).

    A stop is the command less its play operator, so this is the Prandtl–Ishlinskii model: the gain is
    smallest right after a reversal and grows with the amplitude.
    Source: K. Kuhnen, European Journal of Control 9 (2003).
    """

    name = "drive-hysteresis"
    family = "drive"
    site = Site.COMMAND
    cause = "hysteresis"
    symptom = "is a loop over the command that depends on its last reversals and not on the speed"
    n_state = 5
    step = _step

    weight_1: float = size("share that saturates last", low=0.0)
    weight_2: float = size("share that saturates at a third of the last one's change of command", low=0.0)
    weight_3: float = size("share that saturates at a ninth of it", low=0.0)
    weight_4: float = size("share that saturates at a 27th of it", low=0.0)
    reach: float = shape("change of command after which the last share saturates", 1.0, u=1, low=1e-15)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return strokes in each quarter of the rung below the largest command, and one for small loops.

        As of the springs in `hysteresis.py`: a third of a stroke is nearly the same ladder again.
        """
        return [{"reach": max(view.u_peak * part, 1e-15)} for part in (0.1, 0.38, 0.50, 0.66, 0.87)]
