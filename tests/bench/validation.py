"""Errors against closed forms by resolution, as a Markdown table (`make validation`); tests hold them to bounds."""

from tests.contact.test_validation import NODES, QUANTITIES, errors, square_punch_compliance

FINER = (129, 257)  # than those of the tests
NAMES = {"sphere": "Hertz sphere", "cone": "Sneddon cone", "punch": "circular flat punch"}
SHOWN = {"force": "force", "radius": "contact radius", "free volume": "mean displacement (V)"}
LIMIT = 0.86783  # of a square punch, Δ E* l / F


def main() -> None:
    """Print the table."""
    nodes = (*NODES, *FINER)
    print("| contact | error in | " + " | ".join(f"{n}²" for n in nodes) + " |")
    print("|---" * (len(nodes) + 2) + "|")
    for name, title in NAMES.items():
        for place, quantity in enumerate(QUANTITIES):
            if quantity in SHOWN:
                row = " | ".join(f"{errors(name, n)[place]:.1e}" for n in nodes)
                print(f"| {title} | {SHOWN[quantity]} | {row} |")
    row = " | ".join(f"{square_punch_compliance(n) / LIMIT - 1.0:.1e}" for n in nodes)
    print(f"| square flat punch | compliance | {row} |")


if __name__ == "__main__":
    main()
