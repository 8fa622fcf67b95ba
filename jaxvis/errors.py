"""What jaxvis raises and warns with: one line that says what is wrong, where, and what to do."""


class InvalidScene(ValueError):
    """A mesh file or array that cannot be used as a scene."""


class InvalidEnvironment(ValueError):
    """A light probe or array that cannot be used as an environment map."""


class JaxvisWarning(UserWarning):
    """Something in the input was mended or ignored; the message counts what."""
