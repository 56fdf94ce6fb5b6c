# %% [markdown]
# # A serpentine drive: two idlers on the back and a tensioner
#
# The crankshaft drives a water pump and a generator by one ribbed belt, whose smooth back runs on two idlers. One of
# them is the tensioner: a spring pushes it to the right, against the belt's pull, so that its force, not the length
# of the belt, makes the tension. The belt stretches, wears, and the tensioner takes it up.

# %%
from __future__ import annotations

import logging
import math
from pathlib import Path

from effects import effects, table

from belt_fenicsx import load_scene, slip_safety, solve

# DOLFINx 0.5 tells of each form that it compiles, by the root logger.
logging.basicConfig(level=logging.WARNING)
logging.getLogger().addFilter(lambda record: record.levelno > logging.INFO)

HERE = Path(__file__).parent
OUTPUT = HERE / "output"


# %% [markdown]
# ## From the string to the belt
#
# Each row adds one effect to the row above. The tensioner's force gives the slack tension: 250 N are twice the force
# times the sine of half of the wrap. Momentum, rho A v^2 = 39 N, adds to the tension of all spans, as the hub loads
# do not change.

# %%
scene = load_scene(HERE / "serpentine.toml")
found = effects(scene)
belt, string = solve(scene), solve(scene, method="string")
NUMBERS = {
    "tight [N]": lambda solution: solution.contacts[0].tight,
    "slack [N]": lambda solution: solution.contacts[0].slack,
    "take-up [mm]": lambda solution: 1e3 * solution.contacts[1].take_up,
    "wrap of idler [deg]": lambda solution: math.degrees(solution.contacts[4].wrap_angle),
    "efficiency [%]": lambda solution: 100.0 * solution.efficiency,
}
safety, of_string = slip_safety(belt, 3), slip_safety(string, 3)

# %% [markdown]
# ## Where the string is right
#
# In the tensions, to 2 %. But so stiff a belt turns by some 7 degrees next to each end of a contact before it
# touches, and shears there, too: of the small wrap of an idler, less than half is left. A string does not know that.

# %%
tensioner, idler = belt.contacts[1], belt.contacts[4]
assert math.isclose(-tensioner.hub_force[0], 250.0, rel_tol=1e-7)
assert math.isclose(belt.contacts[3].tight / string.contacts[3].tight, 0.98, abs_tol=0.02)
assert math.isclose(safety, of_string, rel_tol=0.1)
missing = [wrap - contact.wrap_angle for wrap, contact in zip(belt.geometric_wraps, belt.contacts, strict=True)]
assert all(angle > 0.0 for angle in missing)
# Of what is missing, bending explains two lift-offs of acos(1 - a / (2 F R^2)) each, of a belt that does not shear.
F, R = tensioner.tight, scene.pulleys[1].radius
assert missing[1] < 2.0 * math.acos(1.0 - scene.belt.bending_stiffness / (2.0 * F * R**2))
assert math.isclose(belt.power, sum(max(contact.power, 0.0) for contact in belt.contacts) + belt.losses, rel_tol=1e-6)


# %%
def headline() -> str:
    """What there is to remember."""
    return (
        f"The spring's 250 N move the tensioner by {1e3 * tensioner.take_up:.1f} mm; of the fixed idler's wrap, "
        f"bending leaves {math.degrees(idler.wrap_angle):.0f} of {math.degrees(belt.geometric_wraps[4]):.0f} degrees."
    )


if __name__ == "__main__":
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(table(found, NUMBERS))
        print(f"\n{headline()}")
        OUTPUT.mkdir(exist_ok=True)
        belt.plot("drive").savefig(OUTPUT / "serpentine.png", dpi=80)
        print(f"Figure: {OUTPUT / 'serpentine.png'}")
