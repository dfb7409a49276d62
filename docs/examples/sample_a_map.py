"""From a log to a decision: whether the way through a door is free."""

import numpy as np

import prf

run = prf.sample("data/demo-office.log.gz", steps=20_000, chains=2, seed=1)
print(run)

places = np.array([[2.0, 5.0], [6.0, 8.1], [6.5, 11.2], [100.0, 5.0]])
print(run.query(places))  # nan outside the window
print(run.query(places, square=0.2))  # is any part of the square occupied?
print(run.return_probability(places))  # does a beam that reaches it end there?

door = [[2.4, 7.2], [2.4, 9.0]]
round_the_desk = [[16.5, 3.0], [18.2, 2.2], [19.6, 3.0]]
print(run.paths([door, round_the_desk], radius=0.25))  # each over whole maps, all of the path at once
free = run.paths([door, round_the_desk], radius=0.25, interval=True)
print(free.low > 0.9)  # certain enough to drive, whatever the sampling left open

look = run.explore(target=door, radius=0.25)  # from where does a scan settle whether that way is free?
print(look.xy[0], look.gain[0], look.entropy)  # metres; nats that it is expected to settle, of so many

walls = run.best_map  # shapely: all of shapely works on it
print(f"{walls.area:.1f} m² occupied, {len(walls.geoms)} pieces")

print(run.occupancy.shape, run.extent)  # for imshow(run.occupancy, extent=run.extent, origin="lower")
axes = run.plot()  # or run.plot(ax) into axes of yours; metres, what no reading saw is hatched
axes.plot(*np.transpose(door), "g")
run.save("office")  # prf render office, prf export office --format ros-map, ...
