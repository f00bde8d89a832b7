"""``python -m posture_opt``: the command line."""

from posture_opt.cli.main import main

if __name__ == "__main__":
    main()
