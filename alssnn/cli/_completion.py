"""`alssnn completion`: commands and options at the tab key."""

import re

HELP = "print a script for completion in bash and zsh"
DESCRIPTION = "Print a script that completes commands and options in bash and zsh."
EPILOG = """\
Commands and options complete at the tab key, and names of files. For the running shell,
and for those to come:

examples:
  alssnn completion > ~/.alssnn-completion
  . ~/.alssnn-completion                              bash, in ~/.bashrc
  autoload -U bashcompinit && bashcompinit            zsh, in ~/.zshrc before it
"""

SCRIPT = """\
_alssnn() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} known="{commands}"
    COMPREPLY=()
    if [ "$COMP_CWORD" -gt 1 ]; then
        case ${{COMP_WORDS[1]}} in
{cases}
        *) known="" ;;
        esac
        case $word in
        -*) ;;
        *) COMPREPLY=($(compgen -f -- "$word")); return ;;
        esac
    fi
    COMPREPLY=($(compgen -W "$known" -- "$word"))
}}
complete -o filenames -F _alssnn alssnn"""


def add(parser):
    """Add no options: it has none of its own.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    options = {name: _options(one) for name, one in args.commands.items()}
    cases = "\n".join(
        f'        {name}) known="{" ".join(flags)}" ;;'
        for name, flags in options.items()
    )
    print(SCRIPT.format(commands=" ".join(options), cases=cases))
    args.result = {"commands": options}


def _options(parser):
    """Return the options of a command, as its help lists them before the examples."""
    listed = parser.format_help().partition(parser.epilog)[0]
    return sorted(set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", listed)))
