"""Imports without what is not asked for, in several threads."""

import sys
from threading import Event, Thread

from fit import lean


def test_threads_import_one_after_the_other():
    inside, other = Event(), "no_module_of_this_name"

    def imported():
        with lean.without([other], "no_package_of_this_name"):
            inside.set()

    thread = Thread(target=imported)
    with lean.without([other], "no_package_of_this_name"):
        assert other in sys.modules
        thread.start()
        assert not inside.wait(0.05)
    thread.join()
    assert inside.is_set()
    assert other not in sys.modules
