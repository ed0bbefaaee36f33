from .application import app as app
from .terminal import print_table as print_table
