"""What the server does for others, and what that costs: nobody gets more of its time than their share.

How it works
------------

A unit of cost is about 50 us of the server's time: a message of a page. Everything that somebody else causes has a
cost: bytes, frames, messages, requests, connections. Each connection has an `Account` with a share of its own, enough
for a page that drives. Beyond this share it spends what is left for its address and in total, which all connections
have in common; a signed-in operator spends a reserve after that. A connection that has nothing left has exceeded its
budget, and `Connections` closes it.

So a flood of one page takes nothing from another page's own share. New connections have budgets of their own, because a
flooder that was sent away comes again; one that exceeded its budget makes the next connections of its address dearer.
"""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import Final

# units a second, and at once
OWN: Final = (80.0, 160.0)
ADDRESS: Final = (200.0, 500.0)
TOTAL: Final = (500.0, 1500.0)
RESERVE: Final = (200.0, 500.0)
# connections a second, and at once
CONNECTS: Final = (10.0, 80.0)
CONNECTS_TOTAL: Final = (30.0, 160.0)
CONNECTS_RESERVE: Final = (10.0, 40.0)
# connections that one costs that exceeded its budget
PENALTY: Final = 10.0

# units: a turn of reading, a byte, a frame, a ping and its answer, a request for an address, an attempt to sign in
TURN_COST: Final = 0.25
BYTE: Final = 1.0 / 256.0
FRAME_COST: Final = 1.0
PING_COST: Final = 4.0
REQUEST: Final = 10.0
SIGN_IN: Final = 10.0

# addresses whose budgets are kept
ADDRESSES_MAX: Final = 1000


class Budget:
    """Allows an average number of units a second, and `burst` at once; the rest is refused."""

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._at = burst, -inf

    def has(self, now: float, cost: float = 1.0) -> bool:
        """Return whether there is budget for a cost."""
        if self._at > -inf:
            self._left = min(self._burst, self._left + self._rate * (now - self._at))
        self._at = now
        return self._left >= cost

    def spend(self, now: float, cost: float = 1.0) -> bool:
        """Spend a cost; return whether there was enough."""
        enough = self.has(now, cost)
        if enough:
            self._left -= cost
        return enough

    def fine(self, now: float, cost: float) -> None:
        """Take a cost, or all there is."""
        self.has(now)
        self._left = max(0.0, self._left - cost)


@dataclass(eq=False)
class Address:
    """What the connections of one address have in common."""

    units: Budget = field(default_factory=lambda: Budget(*ADDRESS))
    connects: Budget = field(default_factory=lambda: Budget(*CONNECTS))
    # whether an operator has signed in from there
    operator: bool = False


class Budgets:
    """The budgets of all addresses, in total, and the operators' reserve."""

    def __init__(self) -> None:
        self._addresses: OrderedDict[str, Address] = OrderedDict()
        self.total, self.reserve = Budget(*TOTAL), Budget(*RESERVE)
        self._connects, self._connects_reserve = Budget(*CONNECTS_TOTAL), Budget(*CONNECTS_RESERVE)

    def address(self, name: str) -> Address:
        """Return the budgets of an address; of too many addresses the oldest are forgotten."""
        found = self._addresses.setdefault(name, Address())
        self._addresses.move_to_end(name)
        if len(self._addresses) > ADDRESSES_MAX:
            self._addresses.popitem(last=False)
        return found

    def admits(self, name: str, now: float) -> bool:
        """Return whether a new connection from an address is within the budgets, and spend it."""
        address = self.address(name)
        if address.connects.has(now) and self._connects.spend(now):
            return address.connects.spend(now)
        return address.operator and self._connects_reserve.spend(now)

    def account(self, name: str) -> "Account":
        """Return the account of a new connection from an address."""
        return Account(self, self.address(name))


@dataclass(eq=False)
class Account:
    """What one connection may still spend."""

    budgets: Budgets
    address: Address
    own: Budget = field(default_factory=lambda: Budget(*OWN))
    # whether it is a signed-in operator's
    operator: bool = False
    exceeded: bool = False
    """Whether it has tried to spend more than there was; it gets nothing any more."""
    close: Callable[[], None] = lambda: None
    """Called when the budget is exceeded."""

    def spend(self, now: float, cost: float) -> bool:
        """Spend a cost; return whether there was enough."""
        if self.exceeded:
            return False
        if self.own.spend(now, cost):
            return True
        address, total = self.address.units, self.budgets.total
        if address.has(now, cost) and total.spend(now, cost):
            return address.spend(now, cost)
        if self.operator and self.budgets.reserve.spend(now, cost):
            return True
        self.exceeded = True
        self.address.connects.fine(now, PENALTY)
        self.close()
        return False
