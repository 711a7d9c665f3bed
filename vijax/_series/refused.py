"""Forces without Taylor series."""


class Refused(ValueError):
    """A force has an operation without a Taylor series here.

    Attributes:
        operation: name of the operation, as in the jaxpr of the force.
    """

    def __init__(self, operation: str, reason: str = "has no Taylor series"):
        self.operation = operation
        super().__init__(
            f"The force uses `{operation}`, which {reason}: write it with other functions of `jax.numpy`, or pass "
            "`flow=vx.DiffraxFlow(diffrax.Dopri8())`."
        )
