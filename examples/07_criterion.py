"""Neighbors belong together if a criterion holds: bright ground, dark streets and the sides of roofs come apart."""

import numpy as np

import streamseg as ss

strip = ss.scenes.columns("airborne", 60_000, seed=5)
even = ss.ConditionalClustering(
    "abs(Intensity - n[0].Intensity) < 3000 and angle < 10",  # the angle is that between the normals of the two
    search_radius=1.0,
    min_segment_size=200,
    sort="descending",
)
print("the criterion is symmetric" if even.is_symmetric else "the order of the points matters")
with ss.stream(strip["xyz"], even, attributes={"Intensity": strip["intensity"]}, result="final") as stream:
    labels = np.full(len(strip["xyz"]), -1)
    for span in stream:
        labels[span.point_ids] = span.segment_ids
print(f"class {stream.exactness}: {stream.promise}")

names = {2: "ground", 5: "vegetation", 6: "building", 11: "road"}
for segment in range(1, labels.max() + 1):
    inside = labels == segment
    classes, counts = np.unique(strip["classification"][inside], return_counts=True)
    most = classes[np.argmax(counts)]
    brightness = np.median(strip["intensity"][inside])
    share = counts.max() / counts.sum()
    print(f"{segment:3} {counts.sum():6} points, intensity {brightness:6.0f}, {share:4.0%} {names.get(most, most)}")
print(f"{stream.left_out.segments:,} small segments are left out, {stream.left_out.points:,} points")
