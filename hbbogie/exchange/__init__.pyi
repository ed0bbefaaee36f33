from .auto import to_auto as to_auto
from .fortran import statements as statements
