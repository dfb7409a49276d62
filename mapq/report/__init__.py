"""Pages and pictures of one result, which open without a network: the map, its regions and its patches."""
