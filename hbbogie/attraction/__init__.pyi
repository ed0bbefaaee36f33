from .basin import find_basin as find_basin
from .decay import Attraction as Attraction
from .decay import measure_attraction as measure_attraction
from .endings import distances as distances
from .endings import place_of as place_of
from .hysteresis import find_hysteresis as find_hysteresis
from .hysteresis import predicted_onset as predicted_onset
