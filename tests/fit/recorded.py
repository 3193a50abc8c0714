"""Channels of a simulated run as telemetry in memory."""

from pathlib import Path

import numpy as np

from fit.telemetry import Telemetry


def recorded(run, channels, fs=10.0):
    a = run.authority
    return Telemetry(
        path=Path(f"{run.name}.h5"),
        run=run.name,
        experiment=run.experiment,
        kind=run.kind,
        fs=fs,
        t0=run.t0,
        F_max_1=a.F_max_1,
        F_max_2=a.F_max_2,
        N_max_1=a.N_max_1,
        N_max_2=a.N_max_2,
        alignment_epoch=run.alignment_epoch,
        m_tm=run.m_tm,
        time=np.arange(channels["o_1"].size) / fs,
        channels=channels,
        units={},
        attributes={},
    )
