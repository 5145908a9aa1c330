"""sim/world/draws.py: streams of random numbers, and rows of them."""

from sim.world import generator, rows


def test_rows_are_the_numbers_in_their_order() -> None:
    drawn, same = (
        rows(generator(5, "wind").standard_normal, 3),
        generator(5, "wind").standard_normal((4, 3)),
    )
    assert [list(next(drawn)) for _ in range(4)] == same.tolist()


def test_purposes_and_seeds_have_streams_of_their_own() -> None:
    assert (
        len({generator(seed, what).random() for seed in (0, 1) for what in ("wind", "noise")}) == 4
    )
