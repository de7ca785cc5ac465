from .model import ClothOnBody as ClothOnBody
from .newton_descent import NewtonDescent as NewtonDescent
