# %% [markdown]
# # A steel band: a textbook's example
#
# A band of 0.003 by 0.75 inch on two pulleys of 4 inches, with a static tension of 250.4 N, transmits 3.39 N m. The
# textbook adds to the static tension, and takes from it, half of torque over radius: 283.8 and 217.1 N. Bending round
# the pulley, the band has a stress of E h / (2 R (1 - nu^2)), 157.6 MPa: it is so wide that it cannot narrow where it
# bends.

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
# ## From the string to the band
#
# Each row adds one effect to the row above. The touching fibre is the lower surface: radii are those of the pulleys,
# and where the band runs up, it gets shorter there and slides forward, in a layer of a fifth of a millimetre.

# %%
scene = load_scene(HERE / "steel_band.toml")
found = effects(scene)
belt = solve(scene)
NUMBERS = {
    "tight [N]": lambda solution: solution.contacts[1].tight,
    "slack [N]": lambda solution: solution.contacts[1].slack,
    "hub load [N]": lambda solution: solution.contacts[1].hub_load,
    "creep [%]": lambda solution: 100.0 * solution.contacts[1].creep,
}
radius, torque = scene.pulleys[1].radius, scene.pulleys[1].torque
textbook = (250.4 + torque / radius / 2.0, 250.4 - torque / radius / 2.0)
wide = belt.bending_stress / (1.0 - scene.belt.poisson_ratio**2)
safety, of_string = slip_safety(belt, 1), slip_safety(found["string"], 1)

# %% [markdown]
# ## Where the string is right
#
# Everywhere, to a tenth of a percent: thickness over radius is 0.0015. What the string does not have is the pressure
# where the band meets and leaves a pulley, for a length of a bending layer, sqrt(a / F), half a millimetre: there it
# is many times what it is between.

# %%
contact = belt.contacts[1]
assert math.isclose(textbook[0], 283.8, abs_tol=0.1) and math.isclose(textbook[1], 217.1, abs_tol=0.1)
for one in (contact, found["string"].contacts[1]):
    assert math.isclose(one.tight, textbook[0], rel_tol=2e-3) and math.isclose(one.slack, textbook[1], rel_tol=2e-3)
assert math.isclose(wide, 157.6e6, rel_tol=1e-3)
assert math.isclose(safety, 3.850, abs_tol=1e-3) and math.isclose(of_string / safety, 1.002, abs_tol=5e-4)
on = belt.fields.zone == next(i for i, zone in enumerate(belt.zones) if zone.pulley == 1)
peak = belt.fields.p.max() * radius / contact.tight
assert peak > 3.0


# %%
def headline() -> str:
    """What there is to remember."""
    return (
        f"{contact.tight:.1f} and {contact.slack:.1f} N in the spans, where the textbook has {textbook[0]:.1f} and "
        f"{textbook[1]:.1f}; bending stress {wide / 1e6:.1f} MPa; safety {safety:.2f}."
    )


if __name__ == "__main__":
    from mpi4py import MPI

    if MPI.COMM_WORLD.rank == 0:
        print(table(found, NUMBERS))
        print(f"\n{headline()}")
        OUTPUT.mkdir(exist_ok=True)
        belt.plot("unrolled").savefig(OUTPUT / "steel_band.png", dpi=80)
        print(f"Figure: {OUTPUT / 'steel_band.png'}")
