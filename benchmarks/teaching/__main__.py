"""``python -m benchmarks.teaching NAME``: one of the measurements behind docs/results/teaching.md."""

from argparse import ArgumentParser

from benchmarks.teaching import laps, light, pictures, takeovers

NAMES = {"pictures": pictures, "laps": laps, "light": light, "takeovers": takeovers}


def main() -> None:
    """Run the measurement that is named."""
    parser = ArgumentParser(prog="benchmarks.teaching", description=__doc__)
    names = parser.add_subparsers(required=True, metavar="NAME")
    for name, module in NAMES.items():
        one = names.add_parser(name, help=(module.__doc__ or "").splitlines()[0])
        module.arguments(one)
        one.set_defaults(main=module.main)
    given = parser.parse_args()
    given.main(given)


if __name__ == "__main__":
    main()
