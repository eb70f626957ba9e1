from .design import Design as Design
from .step_error import StepErrors as StepErrors
