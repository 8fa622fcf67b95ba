"""Lists the experiments and runs them: ``python -m experiments``.

    python -m experiments                                  what there is, table by table
    python -m experiments --all --out DIR                  runs everything (hours), or
    python -m experiments --quick --out DIR                everything at small sizes (minutes)
    python -m experiments NAME [NAME ...] [--quick]        runs these
    python -m experiments NAME [--quick] [its options]     with options of its own
    python -m experiments NAME --help                      what these are
    python -m experiments.results                          writes RESULTS.md from results/

Each runs in a process of its own. What it prints goes to ``DIR/NAME.md`` with the command, the
seconds, the machine and the date; tables as CSV, pictures and ``run.json`` go to ``DIR/NAME/``.
With ``--label OTHER`` they are named so instead of NAME. Options of its own replace what a
full run would set, and come after what ``--quick`` sets. One that fails does not stop the rest.
Exit codes: 0 done, 1 an experiment failed, 2 wrong usage, 130 interrupted.
"""

import sys

from experiments.run import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], usage=str(__doc__)))
