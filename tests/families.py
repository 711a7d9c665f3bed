"""Families of machines that several tests vary."""

import vijax as vx


def rotor(frequency, eccentricity=0.5, clearance=0.6):
    """A rotor with an unbalance, whose load grows with the square of its speed."""
    unbalance = vx.Harmonic([eccentricity * frequency**2], frequency)
    return vx.ImpactSystem([1.0], [[0.1]], [[1.0]], unbalance, [vx.Stop(0, clearance, "upper", 0.7)])


def tower(stiffnesses, frequency=0.8, ratio=0.05):
    """A chain of two masses whose dampers follow from a damping ratio."""
    load = vx.Harmonic([0.3, 0.0], frequency)
    dampings = [2 * ratio * k**0.5 for k in stiffnesses]
    return vx.chain([1.0, 1.0], dampings, stiffnesses, load, [vx.Stop(0, 0.3, "upper", 0.7)])
