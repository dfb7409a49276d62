"""From labels to a model of one's own, and what it says of another part of the map."""

import mapq

town = mapq.read_cloud("data/demo-town.ply.gz")  # field truth: 1 where the robot's odometry had drifted
west = town.xyz[:, 0] < 125.0
labelled = mapq.segment(town.take(west)).labelled("truth")
print(labelled)

by_hand = labelled.label.copy()
by_hand[:3] = 1  # 1 suspicious, 0 plausible, 255 unknown
model = mapq.train(labelled.labelled(by_hand))
print(model.training["n_patches"], "patches,", model.training["n_suspicious"], "of them suspicious")
print({name: round(model.training["held_out"][name], 3) for name in ("recall", "specificity", "auc")})
mapq.write_model("town.model.json", model)

result = mapq.classify(town.take(~west), "town.model.json")
print(f"{result.evaluate('truth').accuracy:.0%} of {len(result.label)} patches as they are in truth")
