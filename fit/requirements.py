"""What a fit requires of a run, in numbers that the planner of a run needs too."""

SHORTEST = 1800.0  # s: below, the band holds too few bins for a noise PSD
F_MAX = 0.1  # Hz, end of the fitted band; archives at 1 Hz are flat up to here
TAPER = 0.1  # fraction of the run under the two cosine flanks of the window
GAP_TAPER = 60.0  # s, flank beside a masked stretch
# s, where noise rises as f^2: sidelobes of a shorter flank carry it to the lowest frequencies
STEEP_GAP_TAPER = 300.0
# of a run; if saturation would take more, nothing is masked and the run cannot be trusted
MOST_SATURATED = 0.3
GAINS = (0.7, 1.5)  # true over commanded force, of any actuator of LISA Pathfinder
