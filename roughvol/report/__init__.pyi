from . import card_page as card_page
from . import page as page
from . import screen as screen
