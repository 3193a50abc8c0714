"""What the campaigns of the tests have in common: flight noise, nominal authority, one experiment."""

ONE_EXPERIMENT = """\
[noise]
oms = "35 fm Hz^-0.5"
thruster = "0.15 uN Hz^-0.5"
plateau = "5.6 fm s^-2 Hz^-0.5"
tail = 1.5

[authority.A]
F_max_1 = "0 pN"
F_max_2 = "2200 pN"
N_max_1 = "10.4 pN m"
N_max_2 = "10.4 pN m"

[[experiments]]
name = "one"
authority = "A"
alignment_epoch = 1
"""

#: A campaign of one short experiment and its noise run.
SHORT_PLAN = f"""
schema = "lpf-campaign/1"
name = "short"
seed = 7

{ONE_EXPERIMENT}duration = "200 s"
noise_duration = "100 s"

[[experiments.injections]]
into = "guidance_o_1"
shape = "sine"
frequency = "50 mHz"
amplitude = "1 nm"
cycles = 5
start = "10 s"
"""
