"""Data under a wrong name, at a wrong time, or with attributes of others."""

from tests.hostile.catalogue.fault import Fault, faults
from tests.hostile.spoiling import all_of, copied, cut, exchanged, labelled, lent

EXCHANGE = "look exchanged|not its own"
AUTHORITY = "authority|F_max|N_max|stiffness|alpha|omega2"
SAME = "same|equal|copy|shared|identical|cannot be two|hold the noise"


def exchange(first: str, second: str, *kinds: str, **more):
    return f"{first} {second}", exchanged(first, second, *kinds, **more)


def attribute(run: str, **attributes):
    return run, labelled(run, **attributes)


EXCHANGED = (
    *faults(
        "data exchanged",
        EXCHANGE,
        ("sysid and noise", "all", *exchange("A2", "D2")),
    ),
    *faults("data exchanged", "", ("same authority and epoch", "all", *exchange("A1", "A1b")), harmless=True),
    *faults("noise runs exchanged", "noise", ("", "all", *exchange("A1", "C4", "noise"))),
)
ATTRIBUTES = (
    *faults(
        "F_max_2 wrong",
        AUTHORITY,
        ("× 2", "", *attribute("B4", F_max_2=2200e-12)),
    ),
    *faults("F_max_2 wrong", "", ("× 1.001", "", *attribute("B4", F_max_2=1101.1e-12)), harmless=True),
    *faults(
        "F_max_1 wrong",
        AUTHORITY,
        ("0 for 2200 pN", "", *attribute("E3", F_max_1=0.0)),
    ),
    *faults(
        "N_max wrong",
        AUTHORITY,
        ("10.4 for 1 pN m, test mass 2", "", *attribute("C2", N_max_2=10.4e-12)),
    ),
    *faults(
        "alignment epoch wrong",
        "epoch|delta_ifo",
        ("4 is 3", "", *attribute("B4", alignment_epoch=3)),
    ),
    *faults("alignment epoch wrong", "", ("2 is 9", "", *attribute("D2", alignment_epoch=9)), harmless=True),
    *faults(
        "t0 wrong",
        "t0|time|overlap|day|before|after|season",
        ("same as B2", "", *attribute("C2", t0="2016-04-19T10:00:00Z")),
    ),
    *faults("t0 wrong", "", ("a year late", "", *attribute("C2", t0="2017-05-10T11:00:00Z")), harmless=True),
    *faults("m_tm wrong", "", ("2 for 1.928 kg", "", *attribute("A2", m_tm=2.0)), harmless=True),
    *faults(
        "kinds exchanged",
        "noise|kind|inject",
        ("", "", "B2", all_of(labelled("B2-sysid", kind="noise"), labelled("B2-noise", kind="sysid"))),
    ),
    *faults(
        "labels of noise runs exchanged",
        "F_max_2|authority",
        (
            "",
            "",
            "B4 D4",
            all_of(labelled("B4-noise", experiment="D4"), labelled("D4-noise", experiment="B4")),
        ),
    ),
)
COPIES = (
    *faults(
        "experiment given again",
        SAME,
        ("once", "all", "D4", copied("D4", 1)),
    ),
    *faults(
        "noise run is a sysid run",
        SAME + "|sysid|inject",
        ("its own", "all", "B4", lent("B4-noise", "B4-sysid")),
    ),
    *faults(
        "sysid run is a noise run",
        SAME + "|noise|inject|answer",
        ("its own", "all", "D4", lent("D4-sysid", "D4-noise")),
    ),
    *faults(
        "noise run shared",
        SAME,
        ("", "all", "B4 C4", lent("C4-noise", "B4-noise")),
    ),
    *faults("run cut short", "short", ("half", "all", "A2", cut("A2-sysid", 0, 10800))),
    *faults("noise run cut short", "", ("2 h", "all", "A2", cut("A2-noise", 0, 7200)), harmless=True),
)
LABELS = (Fault("nothing is wrong", "", "", "", all_of(), harmless=True), *EXCHANGED, *ATTRIBUTES, *COPIES)
