from .model import ClothOnBody as ClothOnBody
from .newton_descent import NewtonDescent as NewtonDescent
from .substeps import step_count as step_count
