"""Maps that outgrow memory or one machine: cut into tiles, segmented and measured tile by tile, labelled as a whole.

`mapq.scale.maps` has the two jobs, and `mapq.scale.run` their stages.
"""
