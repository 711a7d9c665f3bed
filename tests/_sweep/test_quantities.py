"""Quantities of sweeps: against single runs, exact answers, and balances of momentum and energy."""

import numpy as np
import pytest
import xarray as xr
from helpers import slow_except

import vijax as vx

FREQUENCY = "forcing.frequency"
TRANSIENT, RECORD = 3, 4
IMPULSE, ENERGY = "impulse", "dissipated_energy"
# Some hundred roundings, with the amplification of these motions.
ROUNDING = 1e-11
# Relative: sums of some dozen impacts, whose times have rounding errors too.
OF_SUMS = 1e-12
G, MASS, HEIGHT = 9.81, 2.0, 1.0


def sweep(system: vx.ImpactSystem, values: dict, quantities: list[str], **options) -> xr.Dataset:
    options = {"transient": TRANSIENT, "record": RECORD, "progress": False} | options
    return vx.sweep(system, values, quantities=quantities, **options)


def shaken() -> vx.ImpactSystem:
    """A mass between walls of which one moves, with different laws of impact."""
    moving = vx.Harmonic([0.1], 1.3)
    law = vx.FallingRestitution(0.8, 0.5, 0.5)
    stops = [vx.Stop(0, -0.4, "lower", law, motion=moving), vx.Stop(0, 0.3, "upper", 0.6)]
    return vx.ImpactSystem([MASS], [[0.1]], [[1.0]], vx.Harmonic([2.0], 1.3), stops)


def rubbed() -> vx.ImpactSystem:
    """A mass with friction that hits a stop."""
    stops, friction = [vx.Stop(0, 0.3, "upper", 0.7)], [vx.Friction(0, 0.2)]
    return vx.ImpactSystem([MASS], [[0.1]], [[1.0]], vx.Harmonic([2.0], 1.3), stops, friction=friction)


MACHINES = {
    "two masses": (vx.models.wagg_bishop_b(0.8), "stops[0].restitution", [0.5, 0.9]),
    "a moving stop and a law": (shaken(), "stops[0].restitution.speed", [0.3, 1.0]),
    "friction": (rubbed(), "mass[0]", [1.5, 2.0]),
}


@pytest.mark.parametrize("name", slow_except(["two masses"], MACHINES))
@pytest.mark.thorough
def test_impulses_and_losses_are_those_of_single_runs(name):
    system, path, values = MACHINES[name]
    ds = sweep(system, {path: values}, [IMPULSE, ENERGY])
    assert ds.impulse.dims == ds.dissipated_energy.dims == (path, "period", "stop")
    assert not ds.impact_sticks.any()  # chatter is looked at below
    for k in range(len(values)):
        machine = vx.system_of(ds.isel({path: k}))
        period = float(machine.forcing.period)
        sol = vx.simulate(machine, 0.0, (TRANSIENT + RECORD) * period)
        table = sol.events.to_dataframe()
        table = table[(table.kind == "impact") & (table.t > TRANSIENT * period)]
        number = np.floor(table.t / period).astype(int) - TRANSIENT
        of_stops = sol.evaluate_stops(table.t.to_numpy())[1][np.arange(len(table)), table.stop.to_numpy()]
        before, after = (table[f"velocity_{side}"] - np.asarray(of_stops) for side in ("minus", "plus"))
        mass = np.asarray(machine.mass)[[machine.stops[j].mass for j in table.stop]]
        expected = np.zeros((2, RECORD, machine.num_stops))
        np.add.at(expected[0], (number, table.stop), np.abs(table.impulse))
        np.add.at(expected[1], (number, table.stop), mass * (before**2 - after**2) / 2)
        assert len(table) > 3
        found = np.stack([ds[one].isel({path: k}) for one in (IMPULSE, ENERGY)])
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.8])
def test_a_ball_that_comes_to_rest_has_lost_all_its_energy_and_the_floor_has_borne_its_weight(restitution):
    """Infinitely many bounces: their energies add up to m g h, their impulses to the weight in all the time before rest."""
    system = vx.models.bouncing_ball(restitution, gravity=G, mass=MASS)
    options = {"x0": [HEIGHT], "transient": 0, "record": 2}
    ds = sweep(system, {"x0[0]": [HEIGHT, 2 * HEIGHT]}, [IMPULSE, ENERGY], **options)
    assert ds.stuck.all()
    for height, point in zip(ds["x0[0]"].values, (ds.isel({"x0[0]": k}) for k in range(2)), strict=True):
        energy, impulse = (float(point[name].sum()) for name in (ENERGY, IMPULSE))
        assert energy == pytest.approx(MASS * G * height, rel=OF_SUMS)
        flight = np.sqrt(2 * height / G) * (1 + restitution) / (1 - restitution)
        assert impulse == pytest.approx(MASS * G * flight, rel=OF_SUMS)


def test_the_record_is_complete_only_with_the_rest_of_a_chatter():
    """The recorded impacts of the ball alone miss a part of its impulse that the test above would see."""
    ds = sweep(
        vx.models.bouncing_ball(0.3, gravity=G, mass=MASS),
        {"x0[0]": [HEIGHT]},
        [IMPULSE],
        transient=0,
        record=2,
    )
    recorded = MASS * 1.3 * float(np.abs(ds.impact_velocity).sum())
    assert float(ds.impulse.sum()) > recorded * (1 + 100 * OF_SUMS)


def test_elastic_stops_lose_nothing():
    ds = sweep(vx.models.wagg_bishop_a(0.8), {"stops[*].restitution": [1.0]}, [IMPULSE, ENERGY])
    assert float(ds.impulse.sum()) > 0.1
    assert float(ds.dissipated_energy.sum()) == 0


def test_rates_count_impacts_per_unit_of_time():
    ds = sweep(vx.models.wagg_bishop_a(0.8), {FREQUENCY: [0.7, 0.8]}, ["impact_rate"])
    assert ds.impact_rate.dims == (FREQUENCY, "stop")
    time = RECORD * 2 * np.pi / np.array([0.7, 0.8])
    np.testing.assert_allclose(ds.impact_rate * time[:, None], ds.num_impacts, rtol=1e-14)
    assert float(ds.impact_rate.max()) > 0


def test_sections_have_their_other_names():
    ds = sweep(
        vx.models.wagg_bishop_a(0.8), {FREQUENCY: [0.7, 0.8]}, ["section_position", "section_velocity"]
    )
    for name, same in (("section_position", "section_x"), ("section_velocity", "section_v")):
        assert ds[name].dims == ds[same].dims
        np.testing.assert_array_equal(ds[name], ds[same])


def test_a_mass_that_drifts_has_the_velocity_of_its_drift():
    """A free mass thrown at 0.5 under a load of mean 0: x = 0.5 t + a periodic part."""
    system = vx.ImpactSystem([1.0], [[0.0]], [[0.0]], vx.Harmonic([0.3], 1.3, [-np.pi / 2]))
    # The load 0.3 sin(W t) gives the velocity 0.3 (1 - cos W t) / W, of mean 0.3 / W.
    ds = sweep(system, {"v0[0]": [0.5, -0.5]}, ["mean_velocity"])
    assert ds.mean_velocity.dims == ("v0[0]", "mass")
    np.testing.assert_allclose(ds.mean_velocity[:, 0], np.array([0.5, -0.5]) + 0.3 / 1.3, rtol=1e-12)


def test_what_is_not_known_is_nan():
    system = vx.models.wagg_bishop_a(0.8)
    every = ["impact_rate", IMPULSE, ENERGY, "mean_velocity"]
    with pytest.warns(UserWarning, match="max_impacts"):
        cut = sweep(system, {FREQUENCY: [0.8]}, every, max_impacts=1)
    assert np.isnan(cut.impulse).all()
    assert np.isnan(cut.dissipated_energy).all()
    assert not np.isnan(cut.impact_rate).any()  # counts are complete
    with pytest.warns(UserWarning, match="max_steps"):
        short = sweep(system, {FREQUENCY: [0.8]}, every, max_steps=45)
    reached = np.isfinite(short.section_x[0, :, 0].values)
    assert reached.any()
    assert not reached.all()
    np.testing.assert_array_equal(np.isfinite(short.impulse[0, :, 0]), reached)
    assert np.isnan(short.impact_rate).all()
    assert np.isnan(short.mean_velocity).all()


@pytest.mark.thorough
def test_friction_leaves_the_impulse_of_a_complete_chatter_unknown():
    wall = vx.Harmonic([0.2], 1.0, mean=[2.0])
    system = vx.ImpactSystem(
        [1.0], [[0.1]], [[1.0]], wall, [vx.Stop(0, 0.3, "upper", 0.4)], friction=[vx.Friction(0, 0.1)]
    )
    ds = sweep(system, {"stops[0].restitution": [0.4]}, [IMPULSE], transient=0)
    assert ds.impact_sticks.any()
    ends = np.unique(np.floor(ds.impact_time.values[ds.impact_sticks.values] / (2 * np.pi)))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(ds.impulse[0, :, 0])), ends)


def test_parts_on_disk_have_the_same_quantities(tmp_path):
    system, every = vx.models.wagg_bishop_a(0.8), ["impact_rate", IMPULSE, "section_position"]
    values = {"W": (FREQUENCY, [0.7, 0.8, 0.9])}
    whole = sweep(system, values, every)
    written = sweep(system, values, every, out=tmp_path / "out")
    for name in every:
        np.testing.assert_array_equal(written[name], whole[name])
        assert written[name].attrs["long_name"] == whole[name].attrs["long_name"]
    with pytest.raises(ValueError, match="quantities"):
        sweep(system, values, [], out=tmp_path / "out")


@pytest.mark.parametrize("name", ["mean_position", "nonsense"])
def test_a_quantity_that_is_not_available_is_refused_with_those_that_are(name):
    every = "section_position.*section_velocity.*max_position.*impact_rate.*impulse.*dissipated_energy.*mean_velocity"
    with pytest.raises(ValueError, match=rf"{every}.*but has \"{name}\""):
        sweep(vx.models.wagg_bishop_a(0.8), {FREQUENCY: [0.8]}, [IMPULSE, name])


def test_a_name_without_a_list_is_refused():
    with pytest.raises(ValueError, match="must be a list"):
        vx.sweep(vx.models.wagg_bishop_a(0.8), {FREQUENCY: [0.8]}, quantities=IMPULSE)


def test_quantities_that_do_not_follow_from_the_record_are_refused():
    system, values = vx.models.wagg_bishop_a(0.8), {FREQUENCY: [0.8]}
    with pytest.raises(ValueError, match="`record` must be 2"):
        sweep(system, values, ["mean_velocity"], record=1)
    with pytest.raises(ValueError, match="`record` must be 1"):
        sweep(system, values, ["impact_rate"], record=0)
    with pytest.raises(ValueError, match="`max_impacts` be more than 0"):
        sweep(system, values, [IMPULSE], max_impacts=0)
    full = vx.ImpactSystem(
        np.array([[2.0, 0.1], [0.1, 1.0]]), system.damping, system.stiffness, system.forcing, system.stops
    )
    compliant = vx.ImpactSystem(
        system.mass,
        system.damping,
        system.stiffness,
        system.forcing,
        [vx.CompliantStop(0, 0.3, "upper", 20.0)],
    )
    for machine in (full, compliant, vx.models.bead_column(2)):
        with pytest.raises(ValueError, match=r"every rigid stop is a `vx\.Stop`"):
            sweep(machine, {"damping": np.asarray(machine.damping)[None]}, [ENERGY])


@pytest.mark.thorough
def test_impulses_at_rigid_stops_do_not_need_the_others_to_be_rigid():
    stops = [vx.Stop(0, 0.5, "upper", 0.8), vx.CompliantStop(0, -9.0, "lower", 50.0, 0.8)]
    load, names = vx.Harmonic([1.0], 1.0), ["impulse", "dissipated_energy"]
    both, rigid = (
        vx.sweep(
            vx.ImpactSystem([1.0], [[0.1]], [[1.0]], load, own),
            {"forcing.frequency": [1.0, 1.1]},
            transient=9,
            record=3,
            quantities=names,
            progress=False,
        )
        for own in (stops, stops[:1])
    )
    for name in names:
        np.testing.assert_allclose(both[name][..., 0], rigid[name][..., 0], rtol=1e-9)
        assert np.isnan(both[name][..., 1]).all()


@pytest.mark.thorough
def test_the_energy_of_impacts_with_friction_is_known_without_friction_alone():
    """A block thrown along a floor: friction in its impacts takes energy from the sliding motion, of which there is no record."""
    weight = vx.Harmonic([0.0, 0.0], 1.0, mean=[0.0, -G * MASS])
    floor = vx.Stop(1, 0.0, "lower", 0.5)
    none, rubbing = np.zeros((2, 2)), vx.Friction(0, coefficient=0.0, contact=0)
    system = vx.ImpactSystem([MASS, MASS], none, none, weight, [floor], friction=[rubbing])
    ds = vx.sweep(
        system,
        {"friction[0].coefficient": [0.0, 0.3]},
        x0=[0.0, HEIGHT],
        v0=[5.0, 0.0],
        duration=0.5,
        quantities=[IMPULSE, ENERGY],
        progress=False,
    )
    assert ds.num_impacts.values.tolist() == [[1], [1]]
    np.testing.assert_allclose(ds.impulse[:, 0], MASS * 1.5 * np.sqrt(2 * G * HEIGHT), rtol=OF_SUMS)
    np.testing.assert_allclose(ds.dissipated_energy[:, 0], [0.75 * MASS * G * HEIGHT, np.nan], rtol=OF_SUMS)
