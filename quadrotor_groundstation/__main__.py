"""``python -P -m quadrotor_groundstation MODULE …``: that module of ours as a program; see links/child_command.py."""

import runpy
import sys

if __name__ == "__main__":
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
