"""How many cores this process may use."""

import os


def core_count() -> int:
    """Those that it is bound to, where the system tells, else all of the machine's."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
