"""The reference plant: the closed loop without FMUs, in time and in frequency, and what drives it."""
