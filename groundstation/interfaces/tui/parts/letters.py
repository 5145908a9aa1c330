"""Letters three or five rows high, to be read across a room."""

ROWS = 3
"""Height of the smaller letters [rows of text]."""

# Five rows of pixels each; two pixels make one half-block character.
_GLYPHS = {
    "A": ".#. #.# ### #.# #.#",
    "B": "##. #.# ##. #.# ##.",
    "C": ".## #.. #.. #.. .##",
    "D": "##. #.# #.# #.# ##.",
    "E": "### #.. ##. #.. ###",
    "F": "### #.. ##. #.. #..",
    "G": ".### #... #.## #..# .###",
    "H": "#.# #.# ### #.# #.#",
    "I": "# # # # #",
    "J": "..# ..# ..# #.# .#.",
    "K": "#.# #.# ##. #.# #.#",
    "L": "#.. #.. #.. #.. ###",
    "M": "#...# ##.## #.#.# #...# #...#",
    "N": "#..# ##.# #.## #..# #..#",
    "O": ".#. #.# #.# #.# .#.",
    "P": "##. #.# ##. #.. #..",
    "Q": ".##. #..# #..# #.## .###",
    "R": "##. #.# ##. #.# #.#",
    "S": ".## #.. .#. ..# ##.",
    "T": "### .#. .#. .#. .#.",
    "U": "#.# #.# #.# #.# ###",
    "V": "#.# #.# #.# #.# .#.",
    "W": "#...# #...# #.#.# ##.## #...#",
    "X": "#.# #.# .#. #.# #.#",
    "Y": "#.# #.# .#. .#. .#.",
    "Z": "### ..# .#. #.. ###",
    "0": ".#. #.# #.# #.# .#.",
    "1": ".# ## .# .# .#",
    "2": "##. ..# .#. #.. ###",
    "3": "##. ..# .#. ..# ##.",
    "4": "#.# #.# ### ..# ..#",
    "5": "### #.. ##. ..# ##.",
    "6": ".## #.. ##. #.# .#.",
    "7": "### ..# .#. .#. .#.",
    "8": ".#. #.# .#. #.# .#.",
    "9": ".#. #.# .## ..# ##.",
    " ": ".. .. .. .. ..",
    "-": "... ... ### ... ...",
    "?": "##. ..# .#. ... .#.",
}
_HALF = {("#", "#"): "█", ("#", "."): "▀", (".", "#"): "▄", (".", "."): " "}


def big(text: str) -> tuple[str, str, str]:
    """``text`` as three rows of half blocks; a character without a glyph becomes a question mark."""
    pixels = [*_pixels(text), "." * len(_pixels(text)[0])]
    top, middle, bottom = ("".join(_HALF[pair] for pair in zip(*pixels[i : i + 2], strict=True)) for i in (0, 2, 4))
    return top, middle, bottom


def huge(text: str) -> tuple[str, ...]:
    """``text`` as five rows, twice as wide."""
    return tuple(row.replace("#", "██").replace(".", "  ") for row in _pixels(text))


def _pixels(text: str) -> list[str]:
    glyphs = [_GLYPHS.get(letter, _GLYPHS["?"]).split() for letter in text.upper()]
    return [".".join(glyph[row] for glyph in glyphs) for row in range(5)]
