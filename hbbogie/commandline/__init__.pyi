from .main import app as app
from .terminal import in_options as in_options
from .terminal import print_table as print_table
from .terminal import quantities as quantities
from .values import in_own_units as in_own_units
from .values import values_in as values_in
