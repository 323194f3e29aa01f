"""``gliderhpc completion``: completion script of a shell for verbs, options and names."""

import click
from click.shell_completion import get_completion_class

from gliderhpc.cli.main import DONE, program

SHELLS = ("bash", "zsh", "fish")


@click.command("completion")
@click.argument("shell", type=click.Choice(SHELLS))
def command(shell: str) -> int:
    """Print the completion script of SHELL.

    \b
    Examples:
      gliderhpc completion bash > ~/.local/share/bash-completion/completions/gliderhpc
      gliderhpc completion zsh > ~/.zfunc/_gliderhpc
      gliderhpc completion fish > ~/.config/fish/completions/gliderhpc.fish
    """  # noqa: D301 - \b is click's mark for text not to be rewrapped
    click.echo(completion_script(shell))
    return DONE


def completion_script(shell: str) -> str:
    """Return the completion script of one of `SHELLS`."""
    found = get_completion_class(shell)
    if found is None:
        raise click.BadParameter(f"{shell}: this version of click has no completion for it")
    return found(program, {}, "gliderhpc", "_GLIDERHPC_COMPLETE").source()
