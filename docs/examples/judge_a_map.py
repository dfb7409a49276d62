"""From a cloud to a verdict: which walls of this map are not to be trusted, and why."""

import numpy as np

import mapq

whole = mapq.read_cloud("data/demo-town.ply.gz")
corner = whole.take(np.linalg.norm(whole.xyz[:, :2] - [126.0, 10.0], axis=1) < 20.0)

patches = mapq.segment(corner, mapq.SegmentSettings(min_points=100))
print(patches)

features = mapq.patch_features(patches)
print(features.nodes["thickness_m"].max(), features.units["thickness_m"])
edges = features.edges
print(edges[["i", "j", "plausibility"]][edges["plausibility"].argsort()[:3]])

result = mapq.classify(patches)  # by the model of the package
print(result)
print(result.verdict(fail_over=0.05)["passed"])

for region in result.regions[:3]:
    print(f"{region.area:.1f} m² at {region.centre.round(1)}")
    for reason in result.reasons(int(region.patches[0])):
        print(f"  {reason.log_odds:+.2f}  {reason.text}")

trusted = corner.world()[result.suspicious == 0]  # per point: 0, 1, or 255 without a patch
print(len(trusted), "points of plausible walls;", np.nanmax(result.p_suspicious))

result.save("corner.classified.ply", fail_over=0.05)  # mapq render, mapq evaluate, mapq compare read it
