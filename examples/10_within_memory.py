"""A terrestrial scan is dense near the scanner, thin far off: `max_memory` makes windows short here and long there."""

import numpy as np

import streamseg as ss

# What a scanner on a tripod sees of a field up to 100 m away: as many points from 2 m to 4 m as from 50 m to 100 m.
random = np.random.default_rng(5)
distance = 2.0 * 50.0 ** random.random(1_000_000)
turn = random.uniform(0.0, 2.0 * np.pi, 1_000_000)
east, north = distance * np.cos(turn), distance * np.sin(turn)
scan = np.column_stack([east, north, 0.3 * np.sin(east / 9.0) * np.cos(north / 7.0)])
near, far = (np.count_nonzero(abs(east - middle) < 7.5) for middle in (0.0, 90.0))
print(f"fixed spans of 5 m: a window of three holds {near:,} points at the scanner, {far:,} at the rim")

proximity = ss.Proximity(0.5)
for budget in ("150MB", "1GB"):
    plan = ss.plan(scan, proximity, budget)
    peak = plan.peak(threads=2) / 1e6
    print(f"{budget}: {plan.windows} windows of up to {plan.most_points:,} points, a peak of about {peak:.0f} MB")

print("\nwhat 150 MB leads to, and why:")
plan = ss.plan(scan, proximity, "150MB")
for name, text in plan.explain(threads=2):
    print(f"{name:>10}: {text}")

# The budget changes the windows, not the segments.
print(f"\n{ss.verify(scan, proximity, max_memory='150MB')}")
