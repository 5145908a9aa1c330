"""Random draws: every one comes from the seed, one stream a purpose, so that one figure never shifts another's.

They are those of ``numpy.random.default_rng``, to the last bit. One vehicle draws them one by one, in plain Python:
to import numpy takes longer than that in a flight of minutes. Many vehicles draw arrays, from numpy.

The tables are the layers of the ziggurat from which numpy draws standard normal numbers: of each of 256 its width over
2⁵², the density at its edge, and the share of the width (over 2⁵²) below which a draw needs no second look.
Source: numpy 2.4, random/src/distributions/ziggurat_constants.h (BSD), after J. Doornik, An improved ziggurat method to
generate normal random samples, 2005.
"""

import base64
import math
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


_TABLES = """\
edkVeDtJzzzG9v3jC42LPLRbLDyvUJI8YTtEOLl8lTwMpy/o/AGYPLzQTC4MI5o892E4L00AnDx0cnRaL6ydPMPVTC1IMp88rbuOJzJNoDxDXQI7BfWg
PHc2QZemkqE89Rp6j6InojyA2GM4LrWiPPWRV8A/PKM8L7GiwZ69ozxVm/+N7zmkPKf+PTa7saQ8dNMaYnUlpTyWzgengJWlPOp+2c8xAqY8PXyjYdJr
pjxwBQCSotKmPKb4RtPaNqc8dyqzEK2YpzxD9UatRfinPHcKQ1PMVag8mnZ7nmSxqDyYz06pLgupPOoeLIJHY6k8RsU4jsm5qTwsp6TczA6qPFnNd21n
Yqo8MBYQbq20qjycbBNtsQWrPCl6QoeEVas8Op9Sjjakqzwygr8q1vGrPPNOWflwPqw8YTsypROKrDyLJnL+ydSsPEi3gA6fHq08EB/kKZ1nrTzDuCMA
zq+tPFN28ak69608/u3Stes9rjwAb3oz6YOuPM6C+b06ya48JmLwhOcNrzyI9thU9lGvPK7Xh55tla88rC76fVPYrzzsNELgVg2wPJqPOfVALrA8/KUW
nupOsDwQoHJbVm+wPAv0cZCGj7A8E2G8hH2vsDx/zEtmPc+wPGsIFkvI7rA87hWVMiAOsTy+DzEHRy2xPEGRjp8+TLE8HiDEvwhrsTw02ngap4mxPIht
7lEbqLE8yyr4+GbGsTwu1OCTi+SxPJ+gQJmKArI86cbEcmUgsjwfw+l9HT6yPPtrqQy0W7I8f9MdZip5sjwb1xnHgZayPNouuGK7s7I8U7jhYtjQsjyO
qcvo2e2yPNdIbg3BCrM8MLn04Y4nszyhXiZwRESzPNVSyrriYLM8algFvmp9szxksrJv3ZmzPAM9uL87trM84B1WmIbSszyDWnLevu6zPHSe4HHlCrQ8
XXSmLfsmtDykMDzoAEO0PF3HynP3XrQ8NsNmnt96tDwvj0gyupa0PF1BAvaHsrQ83BGzrEnOtDwFpjgWAOq0PGJVXu+rBbU8WosK8k0htTxPZmrV5jy1
PMiyG053WLU8eF9VDgB0tTwUhQ7GgY+1PFkbJCP9qrU8PXN90XLGtTzTjC974+G1PDhen8hP/bU8wx+jYLgYtjyisKLoHTS2PAsmtwSBT7Y8cpbJV+Jq
tjw3MbGDQoa2PLGyUCmiobY8u0Oz6AG9tjxS0yhhYti2PFT4YTHE87Y862iL9ycPtzzGFGlRjiq3PNzucNz3Rbc8H3PlNWVhtzxJ9O/61ny3PJO9ushN
mLc8CRSLPMqztzz7ItvzTM+3POfec4zW6rc8H+qGpGcGuDx2hsjaACK4PBWfic6iPbg8vfXRH05ZuDzFfnpvA3W4PC33R1/DkLg8Q8AFko6suDycDKGr
Zci4PCdqRFFJ5Lg8j7VzKToAuTxHgyjcOBy5PPwK7xJGOLk8iqIDeWJUuTzu1XC7jnC5PDEqLonLjLk8v5k/kxmpuTws2dWMecW5PBF0byvs4bk8StL6
JnL+uTySNvk5DBu6PFvIoiG7N7o8iLsLnn9UujykqUpyWnG6PD0xoGRMjro8CPGfPlarujzO9VrNeMi6PDazi+G05bo8GqHDTwsDuzxbmJrwfCC7PAAM
4KAKPrs8Az3OQbVbuzwniT+5fXm7PDz35fFkl7s8biWF22u1uzyiwC5rk9O7PIOugZvc8bs8oBbsbEgQvDwtevDl1y68PBwNbhOMTbw8BYfsCGZsvDwX
puvgZou8PKuiNr2Pqrw8kNY7x+HJvDw34GgwXum8PG6PizIGCb08IO83ENsovTxHxjMV3ki9PCPx55YQab08pfvX9HOJvTxwbiCZCaq9PA5J/PjSyr08
Ny5SldHrvTwc0kn7Bg2+PPZG6sR0Lr48iNHBmRxQvjwl/pcvAHK+PAq/KkshlL48CG/3wIG2vjw6pxB2I9m+PKnsAWEI/L48IVPCijIfvzxtTbcPpEK/
PGgBySBfZr88gpeJBGaKvzy/InEYu66/PIXnL9Jg0788C/YYwVn4vzx1oNNH1A7APEfJjwKoIcA8qwKpg6k0wDzH9T5O2kfAPH6zrfY7W8A8aCanI9Bu
wDwXLmOPmILAPFSi6AiXlsA8xMBxdc2qwDxI1O7RPb/APDA9qjTq08A8k2URz9TowDy2n6bv//3APEFwIARuE8E8NV27myEpwTxtCcRpHT/BPDsuYEhk
VcE88+6dO/lrwTxhEtJ034LBPKzrTlYamsE8ji9/d62xwTyUpnGpnMnBPDmu5Pvr4cE8Adniwp/6wTyBzASdvBPCPO7Tb3pHLcI8JJyspEVHwjzgWHbH
vGHCPC5ZqPqyfMI8eA53zS6YwjxSCipTN7TCPJfbljHU0MI89XipsQ3uwjzurlbS7AvDPKOkaF57KsM8oxKuBcRJwzxAqDN60mnDPApBVpKzisM8+oiu
cHWswzymBBezJ8/DPHX0YKrb8sM82uW5nKQXxDyUXlQVmD3EPBU6p0TOZMQ8vEOcdWKNxDwnWmudc7fEPAKJzQ0l48Q8QazpU58QxTxCfjpSEUDFPBvk
SqmxccU82Y1xi8ClxTz+0DokitzFPEwehs9pFsY86moAe85TxjzD5Z++QJXGPDLiCY1r28Y8NHpf8CgnxzxzBglWlXnHPIzO1vQt1Mc8NPIpBQM5yDwU
fKq/D6vIPJZEb5TgLsk8q1dAAe7LyTxad5R43I/KPLH9eDgfmMs8M60JgrQ7zTwAAAAAAADwP4fweclqRO8/FalsW1S37j938CfgET/uP5XeBKdv0+0/
8rxXBpJw7T/cGaF4SRTtP+stp6gzvew/f3ipzl5q7D/quu7ZHBvsP4Lc4U7rzus/UvWPOmWF6z8Q3TSCOj7rP6LobD8q+eo/BCV68f616j/hyVDVi3Tq
Pw+v9f2qNOo/2B9l7jv26T+BBiSNIrnpP8F6YVdGfek/R3obwpFC6T9PcTG98QjpP6gK5k9V0Og/At+6SK2Y6D+svDf862HoP27PVg8FLOg/y+IgS+32
5z9YaJx3msLnP9WwoDwDj+c/VthwBx9c5z8SbT/05SnnP+566rpQ+OY/iVpjnljH5j8qO1Fe95bmPyPjkionZ+Y/GAxVmOI35j9lJoCYJAnmP2r/Sm/o
2uU/iVzIrCmt5T+PjUwm5H/lP0aejfATU+U/1WxlWrUm5T9ntiDoxPrkP8BOSU8/z+Q/eFLcciGk5D8SUN9faHnkP3k2SUoRT+Q/4181ihkl5D+CW1iZ
fvvjP6MxrxA+0uM/Ds1iplWp4z/VANorw4DjP+lQ9YuEWOM/NTpwyZcw4z/vOGT9+gjjP+476lWs4eI/SpXXFKq64j8VzZOO8pPiP+0EBSmEbeI/hNuQ
Wl1H4j/y9y+pfCHiPyCWkqng++E/aZlU/ofW4T8R0T9XcbHhP1A8m3CbjOE/2jmGEgVo4T+cqV4QrUPhPzgfMUiSH+E/E1kyorP74D+gQkEQENjgP67Z
cI2mtOA/gV2ZHXaR4D82PPDMfW7gPy4/pq+8S+A/KoKL4TEp4D/EyriF3AbgP6G9e4x3yd8/ygCpp52F3z/zei/LKULfP5WPfnEa/94/VB+9IG683j/F
w05qI3reP4WbX+o4ON4/CTp2R6323T+xVgsyf7XdPzPeJmStdN0/gBACoTY03T9tW660GfTcP0iowHNVtNw/x9cAu+h03D+4LB1v0jXcPxdqYXwR99s/
kW1x1qS42z8bEwd4i3rbP8oxs2LEPNs/UoWhnk7/2j+eWl86KcLaP4DYpEpThdo/TcAg6stI2j8+hEY5kgzaP9+THl6l0Nk/xsAYhASV2T+Tn+DbrlnZ
PxfLM5ujHtk/FfG5/OHj2D+Ikd4/aanYP7ZarKg4b9g/2Q2qf0812D8R2bgRrfvXP7AU9K9Qwtc/61KSrzmJ1z/tscdpZ1DXP0xhqTvZF9c/qkwSho7f
1j8h3oithqfWP+LLJRrBb9Y/FeV7Nz041j/I0oB0+gDWP0TCdkP4ydU/vu7WGTaT1T8AAT1ws1zVP+07U8JvJtU/km2/jmrw1D+inBBXo7rUP9RqrZ8Z
hdQ//iTD78xP1D8ZejXRvBrUP9vSjtDo5dM/rkPxfFCx0z95Ewho83zTP57R+SXRSNM/L/ZaTekU0z9mByF3O+HSP90/lj7HrdI/HrFNQYx60j+J3hcf
ikfSP57M93nAFNI/FoEY9i7i0T9Q8MI51a/RP+hUVO2yfdE/Z+40u8dL0T8jJM9PExrRP8QJh1mV6NA/2kKyiE230D82Q5CPO4bQP9npQiJfVdA/fnTH
9rck0D/Fk9+Ji+jPPzUyuIwQiM8/0pjpbP4nzz9EnMmkVMjOP908KLISac4/hHFFFjgKzj8KkMdVxKvNP09Rsvi2Tc0/zG9eig/wzD9T33GZzZLMP0ed
2LfwNcw/oRi+enjZyz+qMYd6ZH3LPzrRzFK0Ics/BxhXomfGyj9+JhkLfmvKPz1+LTL3EMo/Wv7Sv9K2yT8nfGpfEF3JP2n6dL+vA8k/W4GSkbCqyD84
moGKElLIP3VxH2LV+cc/I6No0/ihxz+mtXqcfErHPxZHln5g88Y/XPIhPqScxj+c8a2iR0bGP/mD+HZK8MU/bB3ziKyaxT81aMipbUXFP8Ef462N8MQ/
Lc71bAycxD/VdQPC6UfEP64xaYsl9MM/7tfoqr+gwz+Iq7QFuE3DP2UqfIQO+8I/Ggd6E8Oowj+3XoOi1VbCPzQ8GCVGBcI/Qn11khS0wT9jLajlQGPB
P7luoh3LEsE/uglSPbPCwD+Fv7hL+XLAPyp9BlSdI8A/LCJryz6pvz8cDlIp/wu/P0ulmvJ7b74/j+h2YbXTvT/lkb25qzi9Pwp0O0lfnrw/FRALaNAE
vD8z4vJ4/2u7PzP2yuns07o/hmLqM5k8uj8ZW53cBKa5P6ugpHUwELk/Uii/nRx7uD/W7z4Byua3P3YRqlo5U7c/TEppc2vAtj8YTYUkYS62P6RmdFcb
nbU/riv6BpsMtT8TIhtA4Xy0P4aaJiPv7bM/cD7Z5MVfsz8RMZvPZtKyP5EN3UTTRbI/fYmXvgy6sT+dF/LQFC+xPyWWFSztpLA/l+QwnpcbsD81bmwr
LCavP4FRskfVFq4/YvGt/i4JrT8sKigPPv2rP3BfOJAH86o/Y1Up+ZDqqT+rtWgq4OOoPx4nr3f73qc/ZNCYs+nbpj/UrfI8stqlP10nEQ5d26Q/y+6Y
zvLdoz+X9D3ofOKiP7xqH58F6aE/EYCWLpjxoD/EpRjXgfifP3WMgtsaEp4/GgnNgxkwnD/46yJOn1KaPwrBALbReZg/gr8L9Nqllj9ksPvy6taUPxNe
q404DZM/EjBgNANJkT9J3XJPKhWPP6yPTyeNpIs/eKSNDQRBiD/gzxpCluuEP5IvlSmSpYE/N2js+GDhfD9duAzZqJ52P/2xsAMfinA/Z7DBQ59fZT8P
97m2BaZUP2rvJYA98w4AAAAAAAAAAACoxvuYvggMAEKBvfpUow0A6u7BfvZRDgB+99PpVbIOALnKfoFL7w4AqkT6CkcZDwAYy/9h7TcPAFwlYZVGTw8A
lqMb5KVhDwCkllN1enAPAJpEKOyyfA8A01djDPGGDwDeJYNXpo8PANrQTccklw8ACfXbB6mdDwB0+oH1YKMPAPhLW95vqA8A3FTTYPGsDwAPuRhn+7AP
AMZ0U42ftA8Ad/5mI+y3DwAO5aHp7LoPAO0LBJ2rvQ8AV2z/YDDADwBIojcQgsIPANFb4nqmxA8AMe56l6LGDwCkliipesgPAIXeS14yyg8AGiMC6czL
DwDEOfgSTc0PAJnsj021zg8AMMkdvwfQDwDmxNZNRtEPAFD04qhy0g8AHsnwT47TDwB4tJCZmtQPAFMPkriY1Q8A7JmOwInWDwAy6MipbtcPAOgIe1RI
2A8AjCytixfZDwDSracH3dkPAIxeEHCZ2g8AIC7AXU3bDwDQ/Ftc+dsPAH2aueud3A8AnXIYgTvdDwCQLzSI0t0PAGSfNmRj3g8ATlGNcO7eDwAutKYB
dN8PAEDtmWX03w8A8iS85G/gDwBYoiXC5uAPAEy4KDxZ4Q8AmT+8jMfhDwCqHNvpMeIPAJEb2oWY4g8AhkG1j/viDwBKjVUzW+MPACoA0Jm34w8Af62e
6RDkDwA0d9RGZ+QPAFwJTNO65A8AJJXSrgvlDwB4vE73WeUPABIS5Mil5Q8AiYYTPu/lDwB4ENlvNuYPAHjVxnV75g8AqhEeZr7mDwDy9OVV/+YPAAKn
AFk+5w8AOZ4+gnvnDwCicHDjtucPAENCd43w5w8AjPBTkCjoDwA6FzX7XugPAGQIhNyT6A8AvM7wQcfoDwD2Tn04+egPAB2bh8wp6Q8A6ojTCVnpDwCi
mpP7hukPAGZIcayz6Q8A1baUJt/pDwB85qtzCeoPAKRm8Zwy6g8ALJUyq1rqDwAadNWmgeoPAPAc3pen6g8AINnzhczqDwA85mV48OoPABPsL3YT6w8A
Sir+hTXrDwC0YjGuVusPAPqE4vR26w8AFCDmX5brDwB8nc/0tOsPANBJ9LjS6w8APi5use/rDwDovR7jC+wPABVasVIn7A8A06+dBELsDwCW8Sn9W+wP
APTubEB17A8AtAxQ0o3sDwASH5G2pewPAP4nxPC87A8AFftUhNPsDwCzyIh06ewPALeRf8T+7A8AKIU1dxPtDwADSYSPJ+0PAEwvJBA77Q8Ablit+03t
DwDdw5hUYO0PAOhPQR1y7Q8AgqnkV4PtDwDILKQGlO0PAAS3hSuk7Q8AtGp0yLPtDwBSZkHfwu0PAFJupHHR7Q8A04o8gd/tDwCAmZAP7e0PABTUDx76
7Q8AxEsSrgbuDwAGWtnAEu4PAOAGkFce7g8AJGVLcynuDwC85AoVNO4PADybuD0+7g8A9IIp7kfuDwCGsB0nUe4PAEF/QOlZ7g8ALrQoNWLuDwDxl1gL
au4PAHoHPmxx7g8AgnsyWHjuDwC6BnvPfu4PALJKSNKE7g8AQ2O2YIruDwBRyMx6j+4PANolfiCU7g8A6imoUZjuDwBcSBMOnO4PAPRzclWf7g8Arsxi
J6LuDwCsQmuDpO4PAHEt/Gim7g8A+tZu16fuDwAK+gTOqO4PADsz6Eup7g8AEGQpUKnuDwBeB8DZqO4PAFR2ieen7g8AJB1IeKbuDwCDnqKKpO4PANrk
Ih2i7g8AJCA1Lp/uDwAurya8m+4PAOTyJMWX7g8AOgo8R5PuDwAWdVVAju4PAHqcNq6I7g8A/T1/joLuDwCIuKfee+4PAP83/5t07g8AXr2pw2zuDwB+
AJ5SZO4PAIgoo0Vb7g8AtldOmVHuDwDPBgBKR+4PAFAs4VM87g8A2CrgsjDuDwAFgq1iJO4PAFo8uF4X7g8ARxQqognuDwDMSeMn++0PAGwhdurr7Q8A
fgQi5NvtDwDTOc4Oy+0PAPQsBGS57Q8AyTjp3KbtDwCN6Tdyk+0PADaoOBx/7Q8AK8C50mntDwAArgaNU+0PACKk3kE87Q8A2C9q5yPtDwBE5i9zCu0P
ADT+B9rv7A8AuLcOENTsDwC0bpUIt+wPAMEwEraY7A8AeKkNCnnsDwD+MQ/1V+wPAGLJhmY17A8ANbO0TBHsDwDQb46U6+sPAJK2oCnE6w8A3Azu9Zrr
DwBChcnhb+sPAJ4frdNC6w8ASy0LsBPrDwDpAhpZ4uoPAFcima6u6g8AJuOOjXjqDwDlc/3PP+oPAPbZjUwE6g8AO1Yv1sXpDwCkR6k7hOkPAChHHUc/
6Q8A1sV2vfboDwDm6MRdqugPAOqxeuBZ6A8AQKmQ9gToDwDAM4JIq+cPAKVqH3VM5w8AAqIqEOjmDwDYq7agfeYPAH4wOJ8M5g8AQvc4c5TlDwCAcpdw
FOUPAFj0NtSL5A8ANx79v/njDwCcse41XeMPAP7kLxK14g8AV1WZAwDiDwAUg3iCPOEPALBn7sRo4A8AqnErsILfDwCq/n7Fh94PAP07xgl13Q8AE78p
5UbcDwCCAi74+NoPAHW6suGF2Q8ABM9I7+bXDwALZb2tE9YPABLw4kkB1A8ArMe0p6HRDwCeH3YE4s4PALIRXtioyw8AIi3NbtLHDwDtIh4vK8MPADq4
wIFlvQ8ANFQAxAa2DwB0KCpYQKwPAJhFAR6Xng8A/B2kSPqJDwAsMPD3xWYPAEocM0taGg8A
"""

_RAW = base64.b64decode(_TABLES)
WIDTHS: tuple[float, ...] = struct.unpack_from("<256d", _RAW)
EDGES: tuple[float, ...] = struct.unpack_from("<256d", _RAW, 2048)
INSIDE: tuple[int, ...] = struct.unpack_from("<256Q", _RAW, 4096)
TAIL = 3.6541528853610087963519472518
"""Where the tail begins, beyond the lowest layer."""


_32 = (1 << 32) - 1
_64 = (1 << 64) - 1
_128 = (1 << 128) - 1
_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
_SHARE = 2.0**-53


def stream(seed: int, purpose: str) -> "Stream":
    """The numbers of ``purpose`` in the flight of ``seed`` (>= 0), one by one."""
    return Stream(_entropy(seed, purpose))


def generator(seed: int, purpose: str) -> "np.random.Generator":
    """Random numbers of ``purpose`` as numpy draws them; arrays of the same numbers as from the stream."""
    import numpy as np

    return np.random.default_rng(_entropy(seed, purpose))


def rows(draw: Callable[[], float], width: int) -> Iterator[tuple[float, ...]]:
    """Rows of ``width`` numbers from ``draw()``, without end."""
    return zip(*[iter(draw, None)] * width, strict=True)  # one iterator, asked for each place of a row in turn


def _entropy(seed: int, purpose: str) -> list[int]:
    return [seed, zlib.crc32(purpose.encode())]


class Stream:
    """PCG64 (XSL-RR, 128 bits of state), seeded as numpy seeds it.

    Source: M. O'Neill, PCG: a family of simple fast space-efficient statistically good algorithms for random number
    generation, 2014; numpy 2.4, random/src/pcg64 and random/src/distributions.
    """

    __slots__ = ("_increment", "_state")

    def __init__(self, entropy: Sequence[int]) -> None:
        """As ``numpy.random.default_rng(entropy)``: whole numbers, none negative."""
        a, b, c, d = _seed_words(entropy)
        self._increment = (c << 64 | d) << 1 & _128 | 1
        self._state = (self._increment + (a << 64 | b)) * _MULTIPLIER + self._increment & _128

    def _next(self) -> int:
        """The next 64 bits."""
        self._state = state = self._state * _MULTIPLIER + self._increment & _128
        folded, turn = (state >> 64 ^ state) & _64, state >> 122
        return (folded >> turn | folded << 64 - turn) & _64

    def random(self) -> float:
        """A number from 0 to below 1, all alike."""
        return (self._next() >> 11) * _SHARE

    def standard_normal(self) -> float:
        """A number of mean 0 and variance 1, by the ziggurat method."""
        while True:
            # _next(), written out: most of what a simulated flight draws is drawn here.
            self._state = state = self._state * _MULTIPLIER + self._increment & _128
            folded, turn = (state >> 64 ^ state) & _64, state >> 122
            bits = (folded >> turn | folded << 64 - turn) & _64
            layer, share = bits & 0xFF, bits >> 9 & 0xFFFFFFFFFFFFF
            x = -share * WIDTHS[layer] if bits & 0x100 else share * WIDTHS[layer]
            if share < INSIDE[layer]:
                return x
            if layer == 0:
                return self._tail(bool(share >> 8 & 1))
            if (EDGES[layer - 1] - EDGES[layer]) * self.random() + EDGES[layer] < math.exp(-0.5 * x * x):
                return x

    def _tail(self, negative: bool) -> float:
        """Beyond the lowest layer, once in some thousand draws."""
        while True:
            x = -math.log1p(-self.random()) * _TAIL_INVERSE
            y = -math.log1p(-self.random())
            if y + y > x * x:
                return -(TAIL + x) if negative else TAIL + x


_TAIL_INVERSE = 0.27366123732975827203338247596
"""1 / TAIL."""


def _seed_words(entropy: Sequence[int]) -> list[int]:
    """Four numbers of 64 bits from ``entropy``: numpy's SeedSequence (M. O'Neill's seed_seq, 2015)."""
    words: list[int] = []
    for number in entropy:
        words.append(number & _32)
        while number := number >> 32:
            words.append(number & _32)
    words += [0] * (4 - len(words))
    by = 0x43B0D7E5

    def hash_word(value: int) -> int:
        nonlocal by
        value ^= by
        by = by * 0x931E8875 & _32
        value = value * by & _32
        return value ^ value >> 16

    def mix(one: int, other: int) -> int:
        value = 0xCA01F9DD * one - 0x4973F715 * other & _32
        return value ^ value >> 16

    pool = [hash_word(word) for word in words[:4]]
    for source in range(4):
        for target in range(4):
            if source != target:
                pool[target] = mix(pool[target], hash_word(pool[source]))
    for word in words[4:]:
        for target in range(4):
            pool[target] = mix(pool[target], hash_word(word))
    by, halves = 0x8B51F9DD, []
    for n in range(8):
        value = pool[n % 4] ^ by
        by = by * 0x58F38DED & _32
        value = value * by & _32
        halves.append(value ^ value >> 16)
    return [low | high << 32 for low, high in zip(halves[::2], halves[1::2], strict=True)]
