from . import dataset as dataset
from . import variants as variants
from .run import StoredRun as StoredRun
from .run_folder import folder_of as folder_of
from .run_status import Status as Status
from .run_status import status as status
