"""Data under a wrong name, at a wrong time, or with attributes of others."""

from tests.hostile.catalogue.fault import Fault, faults
from tests.hostile.spoiling import all_of, changed, copied, cut, exchanged, labelled, lent

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
        ("sysid and noise", "all", *exchange("B4", "C4")),
        ("sysid and noise", "all", *exchange("B4", "D4")),
        ("sysid and noise", "all", *exchange("A1", "B2")),
        ("sysid and noise", "all", *exchange("E3", "F3")),
        ("sysid", "all", *exchange("B4", "C4", "sysid")),
        ("sysid", "f_x_2", *exchange("B2", "C2", "sysid", channels=("f_x_2",))),
    ),
    *faults("data exchanged", "", ("same authority and epoch", "all", *exchange("A1", "A1b")), harmless=True),
    *faults("noise runs exchanged", "noise", ("", "all", *exchange("A1", "C4", "noise"))),
)
ATTRIBUTES = (
    *faults(
        "F_max_2 wrong",
        AUTHORITY,
        ("× 2", "", *attribute("B4", F_max_2=2200e-12)),
        ("× 0.1", "", *attribute("A2", F_max_2=220e-12)),
        ("× 20", "", *attribute("D4", F_max_2=1000e-12)),
        ("× 1.1", "", *attribute("A1", F_max_2=2420e-12)),
        ("× 1000", "", *attribute("A1b", F_max_2=2.2e-6)),
    ),
    *faults("F_max_2 wrong", "", ("× 1.001", "", *attribute("B4", F_max_2=1101.1e-12)), harmless=True),
    *faults(
        "F_max_1 wrong",
        AUTHORITY,
        ("0 for 2200 pN", "", *attribute("E3", F_max_1=0.0)),
        ("half", "", *attribute("G3", F_max_1=2200e-12)),
    ),
    *faults(
        "N_max wrong",
        AUTHORITY,
        ("10.4 for 1 pN m, test mass 2", "", *attribute("C2", N_max_2=10.4e-12)),
        ("× 2, test mass 1", "", *attribute("F3", N_max_1=3e-12)),
        ("1 and 2 exchanged", "", *attribute("G3", N_max_1=10.4e-12, N_max_2=1.5e-12)),
    ),
    *faults(
        "alignment epoch wrong",
        "epoch|delta_ifo",
        ("4 is 3", "", *attribute("B4", alignment_epoch=3)),
        ("1 is 2", "", *attribute("A1b", alignment_epoch=2)),
        ("3 is 4", "", *attribute("G3", alignment_epoch=4)),
        ("4 is 1, of two runs", "", *attribute("C4", alignment_epoch=1)),
    ),
    *faults("alignment epoch wrong", "", ("2 is 9", "", *attribute("D2", alignment_epoch=9)), harmless=True),
    *faults(
        "t0 wrong",
        "t0|time|overlap|day|before|after|season",
        ("noise a year early", "", "C2", labelled("C2-noise", t0="2015-05-10T11:00:00Z")),
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
        ("nine times", "all", "A1", copied("A1", 9)),
        (
            "twice, cut and scaled by 1 + 1e-12",
            "all",
            "B2",
            all_of(
                copied("B2", 2),
                *(cut(f"B2x{n}-sysid", 30 * n, 21600 - 17 * n) for n in (0, 1)),
                *(changed(f"B2x{n}-sysid", o_12=lambda x: x * (1 + 1e-12)) for n in (0, 1)),
            ),
        ),
    ),
    *faults(
        "noise run is a sysid run",
        SAME + "|sysid|inject",
        ("its own", "all", "B4", lent("B4-noise", "B4-sysid")),
        ("another", "all", "C4", lent("C4-noise", "B4-sysid")),
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
        ("of another season", "all", "C4 A1", lent("C4-noise", "A1-noise")),
    ),
    *faults("run cut short", "short", ("half", "all", "A2", cut("A2-sysid", 0, 10800))),
    *faults("noise run cut short", "", ("2 h", "all", "A2", cut("A2-noise", 0, 7200)), harmless=True),
)
LABELS = (Fault("nothing is wrong", "", "", "", all_of(), harmless=True), *EXCHANGED, *ATTRIBUTES, *COPIES)
