"""Looking at a scene while its light turns: frames of any method, and a viewer in the browser."""

from jaxvis.view.app import App
from jaxvis.view.session import Frame, Look, Session

__all__ = ["App", "Frame", "Look", "Session"]
