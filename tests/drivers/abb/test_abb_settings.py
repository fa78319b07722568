from __future__ import annotations

import pytest
from pydantic import ValidationError

from cellwatt_drivers.abb import AbbSettings


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"egm": [], "web": []}, "name something in 'egm' or in 'web'"),
        ({"egm": ["joints", "joints"]}, "each once"),
        ({"rate": "100 Hz"}, "whole part"),
        ({"rate": "500 Hz"}, "250 Hz"),
        ({"web_rate": "20 Hz"}, "less than or equal to 10"),
    ],
)
def test_wrong_settings_say_what_is_wrong(changes, why):
    with pytest.raises(ValidationError, match=why):
        AbbSettings.model_validate({"host": "192.0.2.1"} | changes)
