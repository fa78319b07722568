"""Makes the channel of a recipient. The libraries behind it are loaded here, when a channel is first made."""

from __future__ import annotations

from cellwatt.outlets.notify.answer import Channel
from cellwatt.outlets.notify.settings import MailSettings, RecipientSettings
from cellwatt.outlets.notify.texts import About


def make(to: RecipientSettings, about: About, timeout: float) -> Channel:
    """Make the channel of a recipient; one attempt takes at most ``timeout`` s."""
    settings = to.channel
    if isinstance(settings, MailSettings):
        from cellwatt.outlets.notify.mail import Mail

        return Mail(settings, about, timeout)
    from cellwatt.outlets.notify.web import WebChannel

    return WebChannel(settings, about, timeout)
