from .main import app as app
from .main import main as main
from .terminal import print_table as print_table
