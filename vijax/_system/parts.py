"""The parts of a machine as they are given: load, stops, friction and Jenkins elements, and what each must be beside the others."""

from collections.abc import Iterator, Sequence
from typing import Any

import equinox as eqx
from jaxtyping import Array

from .._jax.concrete import concrete
from .._jax.errors import checked
from .checks import check_room, check_slots
from .compliant import CompliantContact, CompliantStop
from .contact import Contact
from .forcing import Harmonic
from .friction import Friction
from .hysteresis import Jenkins
from .load import AbstractLoad, LoadSum
from .stop import Stop

AnyStop = Stop | Contact | CompliantStop | CompliantContact


def check_parts(forcing: Any, stops: Any, friction: Any, hysteresis: Any) -> None:
    """Reject a `forcing` that is not a load, or `stops`, `friction` or `hysteresis` that are not lists of such."""
    if not isinstance(forcing, AbstractLoad):
        raise ValueError(
            "Argument `forcing` must be a load, a `vx.Harmonic`, `vx.Tabulated` or `vx.Waveform`, or a sum of such by `+`, or None "
            f"if nothing drives the machine, but is {forcing!r}."
        )
    for name, given, kind, words in (
        ("stops", stops, AnyStop, "`vx.Stop`, `vx.Contact`, `vx.CompliantStop` and `vx.CompliantContact`"),
        ("friction", friction, Friction, "`vx.Friction`"),
        ("hysteresis", hysteresis, Jenkins, "`vx.Jenkins`"),
    ):
        if not isinstance(given, list | tuple) or not all(isinstance(one, kind) for one in given):
            raise ValueError(
                f"Argument `{name}` must be a list of {words}, also where there is one, but is {given!r}."
            )


def forces_of(forcing: AbstractLoad) -> Iterator[tuple[str, Array]]:
    """Paths of the forces of all loads, and their values."""
    for k, load in enumerate(forcing.loads):
        name = "amplitude" if isinstance(load, Harmonic) else "values"
        where = f"forcing[{k}]" if isinstance(forcing, LoadSum) else "forcing"
        yield f"{where}.{name}", getattr(load, name)


def of_one_frequency(
    forcing: AbstractLoad, stops: Sequence[AnyStop]
) -> tuple[AbstractLoad, tuple[AnyStop, ...]]:
    """Keep the frequency in the load alone, so that a change there applies everywhere."""
    same = []
    for j, stop in enumerate(stops):
        if stop.motion is not None and stop.motion.frequency is not None:
            if forcing.why_not_periodic:
                raise ValueError(
                    f"`stops[{j}]` moves with a period, which the load must have too. {forcing.why_not_periodic}"
                )
            differs = stop.motion.frequency != forcing.frequency
            sentence = f"The frequency of `stops[{j}].motion` must be that of the load, `forcing.frequency`."
            known = concrete(differs)
            if known is not None and known.any():
                raise ValueError(sentence)
            if known is None and stop.motion.frequency is not forcing.frequency:
                sure = checked(forcing.frequency, differs.astype(int), ("", sentence))
                forcing = eqx.tree_at(lambda f: f.frequency, forcing, sure)
            stop = eqx.tree_at(lambda s: s.motion.frequency, stop, None)
        same.append(stop)
    return forcing, tuple(same)


def check_stops(stops: Sequence[AnyStop], num_masses: int) -> None:
    """Reject stops of masses that there are not, two stops on one side of a mass, and stops that leave no room between them."""
    places: dict[tuple[int, str], int] = {}
    for j, stop in enumerate(stops):
        unknown = [mass for mass in stop.coefficients if mass >= num_masses]
        if unknown:
            name = f"`stops[{j}].row` names mass" if stop.slot is None else f"`stops[{j}].mass` is"
            raise ValueError(f"{name} {unknown[0]}, but the machine has masses 0 to {num_masses - 1}.")
        if stop.is_compliant:
            continue
        if stop.slot in places:
            mass, side = stop.slot
            raise ValueError(
                f"`stops[{places[stop.slot]}]` and `stops[{j}]` are both {side} stops of mass {mass}: keep "
                "the nearer one."
            )
        if stop.slot is not None:
            places[stop.slot] = j
    check_slots(tuple(stops))
    check_room(tuple(stops))


def check_rows(name: str, elements: Sequence[Any], num_masses: int) -> None:
    """Reject elements whose rows name masses that there are not."""
    for k, element in enumerate(elements):
        unknown = [mass for mass in element.coefficients if mass >= num_masses]
        if unknown:
            raise ValueError(
                f"`{name}[{k}].row` names mass {unknown[0]}, but the machine has masses 0 to {num_masses - 1}."
            )


def check_friction(friction: Sequence[Friction], num_stops: int, num_masses: int) -> None:
    """Reject friction of masses, or of contacts, that there are not."""
    check_rows("friction", friction, num_masses)
    for k, element in enumerate(friction):
        if element.contact is not None and element.contact >= num_stops:
            stops = "no stops" if not num_stops else f"stops 0 to {num_stops - 1}"
            raise ValueError(
                f"`friction[{k}].contact` is {element.contact}, but the machine has {stops}: it must be the number of the stop whose "
                "force presses."
            )
