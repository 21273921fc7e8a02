"""A vehicle drives up a street and back: without `revisit` it finds the same things twice, and `verify` shows where."""

import numpy as np

import streamseg as ss

street = ss.scenes.columns("street", 300_000, seed=5)
standing = ~np.isin(street["classification"], [2, 11])  # all but ground and road
points, object_id = street["xyz"][standing], street["object_id"][standing]
is_car = street["classification"][standing] == 64
print(f"{len(np.unique(object_id[is_car]))} cars stand in the street")

# Every second point is measured on the way up, the others on the way back.
up, back = np.arange(0, len(points), 2), np.arange(1, len(points), 2)[::-1]
drive = np.concatenate([up, back])

near = ss.Proximity(0.3, graph="radius", min_segment_size=50)
for revisit in (False, True):
    scanner = iter(np.array_split(points[drive], 40))  # a live source: what has been handed over is gone
    with ss.stream(scanner, near, result="final", revisit=revisit) as stream:
        labels = np.concatenate([span.segment_ids for span in stream])
    cars = np.unique(labels[is_car[drive] & (labels > 0)])
    things = np.unique(labels[labels > 0])
    print(f"revisit={revisit}: {len(things)} things, {len(cars)} of them cars; {stream.certificate}")
print(stream.promise)

# DBSCAN may have to take back what it has decided. In a stored cloud its decisions wait, and verify compares.
for revisit in (False, True):
    print(f"\nDBSCAN, revisit={revisit}")
    print(ss.verify(points[drive], ss.Dbscan(0.3), spans=ss.SpanByCount(2_000), revisit=revisit))
