from .models import SHIPPED as SHIPPED
from .models import shipped_model as shipped_model
