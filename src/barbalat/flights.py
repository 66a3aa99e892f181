"""Controllers flown on flight models through failures: JSBSim's F-16, MuJoCo's quadrotor, and other installed vehicles."""

from barbalat.public_names import public

__getattr__, __dir__, __all__ = public(__name__)
