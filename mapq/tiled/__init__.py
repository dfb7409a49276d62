"""Maps that outgrow memory: segmented and measured in tiles with a halo, and labelled by one random field."""
