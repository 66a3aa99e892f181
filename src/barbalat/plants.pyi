from .problem.actuation import PlantInput as PlantInput
from .problem.known_set import ParameterBall as ParameterBall
from .problem.labels import Labels as Labels
from .problem.measurement import Noise as Noise
from .problem.measurement import Sensor as Sensor
from .problem.tracking import Disturbance as Disturbance
