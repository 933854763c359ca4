"""Base of the nodes that need the exemplar bank."""

from __future__ import annotations

from typing import ClassVar

from depth_pose.bank import Bank, default_bank_path
from depth_pose.ros.messages import people
from depth_pose.ros.nodes.node_base import StageNode


class BankNode(StageNode):
    """A node whose stage needs the bank of the parameter ``bank``, which is loaded once.

    Attributes
    ----------
    needs_views : bool
        Whether it searches the bank; else the views are released.
    """

    needs_views: ClassVar[bool] = False
    _bank: Bank | None = None

    @property
    def bank(self) -> Bank:
        """The exemplar bank.

        Raises
        ------
        BankError
            If the file is missing, damaged or foreign.
        """
        if self._bank is None:
            bank = Bank.load(self.value("bank") or default_bank_path())
            self._bank = bank if self.needs_views else bank.without_views()
        return self._bank

    def prepare(self) -> None:
        """Build the stage, and compile what reads its input."""
        people.warm_up()
        super().prepare()
