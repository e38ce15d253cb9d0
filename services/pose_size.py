"""The services' edge: poses on the wire must have the skeleton's parameters, which proto does not know."""

from proto.framing import MalformedMessage
from proto.messages import Message, arrays_of
from services.mocap.body.kinematics import N_DOF


def with_whole_poses(message: Message) -> Message:
    """The message itself; raises MalformedMessage where poses in it have another number of parameters (D)."""
    for name, spec in arrays_of(type(message)).items():
        size = getattr(message, name).shape[-1]
        if spec.shape[-1] == "D" and size != N_DOF:
            raise MalformedMessage(f"{message.type}.{name}: size {size} where D is {N_DOF}")
    return message
