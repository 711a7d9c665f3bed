"""Words that arguments take, for type checkers and editors; at run time wrong words are refused in sentences."""

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    Carry = Literal["up", "down", "both"]
    Quantity = Literal[
        "section_position",
        "section_velocity",
        "max_position",
        "min_position",
        "peak_to_peak",
        "max_velocity",
        "min_velocity",
        "rms_position",
        "rms_velocity",
        "max_acceleration",
        "min_acceleration",
        "rms_acceleration",
        "max_absolute_acceleration",
        "max_force",
        "impulse",
        "dissipated_energy",
        "impact_rate",
        "hysteresis_energy",
        "mean_velocity",
    ]
    ImpactOrdinate = Literal["velocity", "relative velocity", "phase"]
else:
    Carry = Quantity = ImpactOrdinate = str
