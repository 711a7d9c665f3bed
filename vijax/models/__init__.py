"""Ready-made machines, each with its reference."""

from .._calls import with_explained_errors
from .._signatures import with_short_signature
from ._balls import (
    ball_between_walls as ball_between_walls,
    ball_on_table as ball_on_table,
    bead_column as bead_column,
    bouncing_ball as bouncing_ball,
)
from ._beams import cantilever as cantilever
from ._buildings import pounding_buildings as pounding_buildings
from ._chains import (
    uniform_chain as uniform_chain,
    wagg_bishop_a as wagg_bishop_a,
    wagg_bishop_b as wagg_bishop_b,
)
from ._dampers import impact_damper as impact_damper
from ._drilling import drill_bit as drill_bit
from ._friction import (
    FrictionLoss as FrictionLoss,
    capsule_robot as capsule_robot,
    friction_damped_pair as friction_damped_pair,
    friction_oscillator as friction_oscillator,
    soft_impact_oscillator as soft_impact_oscillator,
)
from ._gears import (
    gear_mesh as gear_mesh,
    gear_pair as gear_pair,
)
from ._hysteresis import iwan as iwan
from ._nonlinear import (
    CubicSpring as CubicSpring,
    PendulumWeight as PendulumWeight,
    duffing_oscillator as duffing_oscillator,
    impacting_pendulum as impacting_pendulum,
)
from ._oscillators import (
    impact_oscillator as impact_oscillator,
    impact_pair as impact_pair,
    two_sided_oscillator as two_sided_oscillator,
)
from ._percussion import (
    drop_hammer as drop_hammer,
    percussive_drill as percussive_drill,
    vibro_impact_harvester as vibro_impact_harvester,
)
from ._pistons import multi_piston as multi_piston
from ._rotors import (
    shaken_oscillator as shaken_oscillator,
    unbalanced_rotor as unbalanced_rotor,
)
from ._woodpecker import woodpecker as woodpecker

for _name, _public in list(globals().items()):
    if _name not in ("with_explained_errors", "with_short_signature"):
        globals()[_name] = with_explained_errors(with_short_signature(_public), __name__)
del _name, _public, with_explained_errors, with_short_signature
