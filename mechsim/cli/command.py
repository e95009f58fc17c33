"""Commands are functions: dataclasses declare options, a `Result` gives text, JSON and the exit code.

Paths of files that commands write are options too, checked before any computation.
"""

import inspect
import os
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import typer

from mechsim import files, units
from mechsim.cli.output import print_json
from mechsim.cli.progress import reported
from mechsim.errors import InputError, OutputError, require_extra, require_once

JSON_OPTION = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a command.

    Attributes:
        data: the object that --json prints, a table or a record; `mechsim schema` describes it.
        text: function that prints the result as text.
        passed: whether the exit code is 0; otherwise it is 1.
        files: paths of written files, listed after the text; None is skipped.
    """

    data: Any
    text: Callable[[], object] = lambda: None
    passed: bool = True
    files: Sequence[str | None] = ()

    def print(self, as_json: bool) -> None:
        """Print the JSON object or the text, and end the command with exit code 1 if it failed."""
        if as_json:
            print_json(self.data)
        else:
            self.text()
            for path in filter(None, self.files):
                typer.echo(f"wrote {path}")
        if not self.passed:
            raise typer.Exit(1)


class Without:
    """Marks options of a dataclass that a command does not have, since they would have no effect on it."""

    def __init__(self, *hidden: str):
        self.hidden = hidden


@dataclass(frozen=True, slots=True)
class Stated:
    """The options that the command line states: parameter -> option, as --samples."""

    options: Mapping[str, str]

    def exclude(self, parameters: Collection[str], where: str, when: object = True) -> None:
        """Raise InputError for a stated option that has no effect where the text says, as in a free run."""
        for parameter, name in self.options.items():
            if when and parameter in parameters:
                raise InputError(f"{name} has no effect {where}; leave it out")


def _stated(context: typer.Context) -> Stated:
    """Return the options that are given on the command line, and not by default."""
    parameters = [
        parameter
        for parameter in context.command.params
        if getattr(context.get_parameter_source(parameter.name or ""), "name", "") == "COMMANDLINE"
    ]
    return Stated({parameter.name or "": max(parameter.opts, key=len) for parameter in parameters})


def command(function: Callable[..., Any]) -> Callable[..., None]:
    """Return a function whose parameters are options of the command line.

    A parameter whose default `units.option` declares is an option. A parameter whose type is a dataclass
    becomes an option for each field that `units.option` declares or whose type is `Annotated` with a typer
    option; other fields keep their defaults, and so do those that `Annotated[cls, Without("name")]` names.
    A parameter of type `Stated` receives the options on the command line. A function that returns a `Result`
    gets the option --json.
    """
    signature, keyword = inspect.signature(function, eval_str=True), inspect.Parameter.KEYWORD_ONLY
    parameters: list[inspect.Parameter] = []
    own: dict[str, Field[Any]] = {}
    stated: str | None = None
    groups: dict[str, tuple[Callable[..., Any], list[Field[Any]]]] = {}
    for name, parameter in signature.parameters.items():
        kinds = (parameter.annotation, *get_args(parameter.annotation)[:1])
        cls: Any = next((kind for kind in kinds if is_dataclass(kind)), None)
        if cls is Stated:
            stated = name
            parameters.append(parameter.replace(kind=keyword, annotation=typer.Context))
        elif isinstance(parameter.default, Field):
            own[name] = parameter.default
            parameters.append(_parameter(name, parameter.default, parameter.annotation))
        elif cls is None:
            parameters.append(parameter.replace(kind=keyword))
        else:
            types = get_type_hints(cls, include_extras=True)
            hidden = {name for item in get_args(parameter.annotation) for name in getattr(item, "hidden", ())}
            declared = [
                field
                for field in fields(cls)
                if field.name not in hidden
                and ("doc" in field.metadata or get_origin(types[field.name]) is Annotated)
            ]
            groups[name] = cls, declared
            parameters += [_parameter(field.name, field, types[field.name]) for field in declared]
    returned = signature.return_annotation
    has_json = Result in (returned, *get_args(returned)) and "as_json" not in signature.parameters
    if has_json:
        parameters.append(inspect.Parameter("as_json", keyword, default=False, annotation=JSON_OPTION))

    def run(**values: Any) -> None:
        as_json = values.pop("as_json", False) if has_json else values.get("as_json", False)
        for name, (make, declared) in groups.items():
            values[name] = make(
                **{field.name: _value(field.name, field, values.pop(field.name)) for field in declared}
            )
        values |= {name: _value(name, field, values[name]) for name, field in own.items()}
        if stated is not None:
            values[stated] = _stated(values[stated])
        with reported(function.__name__.partition("_")[0]):
            result = function(**values)
        if result is not None:
            result.print(as_json)

    wrapped: Any = wraps(function)(run)
    wrapped.__signature__ = inspect.Signature(parameters)
    wrapped.__annotations__ = {}
    return wrapped


def _parameter(name: str, field: Field[Any], kind: Any) -> inspect.Parameter:
    """Return the parameter that typer reads for a field or for a declared default."""
    rule, default = field.metadata, field.default
    if "doc" in rule:
        kind, default = _declared(kind, default, rule)
        names = (rule["name"],) if rule["name"] else ()
        kind = Annotated[kind, typer.Option(*names, metavar=rule["metavar"], help=rule["doc"])]
    default = inspect.Parameter.empty if default is MISSING else default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)


def _declared(kind: Any, default: Any, rule: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return the type and default of an option on the command line."""
    if rule["many"]:
        return list[str] | None, None
    if rule["unit"] or rule["read"]:
        if default is MISSING:
            return str, MISSING
        return (str, rule["text"]) if rule["text"] else (str | None, None)
    return (bool if isinstance(default, bool) else kind), default


def _value(name: str, field: Field[Any], text: Any) -> Any:
    """Return the value of an option from its text; the default if there is none.

    Raises:
        InputError: for an invalid text, or if two values NAME=VALUE have the same name.
    """
    rule = field.metadata
    if "doc" not in rule:
        return text
    if text is None:
        return field.default
    option_name = rule["name"] or f"--{name.replace('_', '-')}"
    if rule["many"]:
        values = tuple(map(rule["read"], text))
        require_once(option_name, [value[0] for value in values if isinstance(value, tuple)])
        return values
    if rule["read"]:
        return rule["read"](text)
    return units.parse(text, rule["unit"], option_name) if rule["unit"] else text


def output_file(contents: str, *suffixes: str, name: str = "--output", metavar: str = "FILE") -> Any:
    """Declare an option for a file to write; its help states the contents and the suffixes.

    The path, or each of a list, is checked before the command runs; without suffixes the command checks it.
    """

    def check(context: typer.Context, value: Any) -> Any:
        if suffixes and not context.resilient_parsing:
            for path in [value] if isinstance(value, str) else value or ():
                writable(path, *suffixes)
        return value

    names = ("-o", name) if name == "--output" else (name,)
    return typer.Option(*names, metavar=metavar, help=contents, callback=check)


TABLES, PLOTS = (".csv", ".npz"), (".svg", ".pdf", ".png")


def table_file(contents: str) -> Any:
    """Declare the option for a table to write, as `output_file`."""
    return output_file(f"{contents}: .csv or .npz.", *TABLES)


def table_or_plot_file(table: str, plot: str, tables: tuple[str, ...] = TABLES) -> Any:
    """Declare the option, to be given once or twice, for a table and a plot to write."""
    contents = f"{table}: {' or '.join(tables)}; or {plot}: .svg, .pdf or .png. Give it twice for both."
    return output_file(contents, *tables, *PLOTS)


def one_of_each(paths: Sequence[str] | None, *kinds: tuple[str, ...]) -> list[str | None]:
    """Return the path with a suffix of each kind, None without one.

    Raises:
        InputError: for two paths of one kind.
    """
    chosen: list[str | None] = []
    for suffixes in kinds:
        own = [path for path in paths or () if Path(path).suffix.lower() in suffixes]
        if len(own) > 1:
            raise InputError(f"-o names {' and '.join(map(repr, own))}; give one of each kind")
        chosen.append(own[0] if own else None)
    return chosen


def writable(path: str, *extensions: str) -> Path:
    """Return an output path, checked before any computation."""
    target = Path(path)
    if os.path.isdir(target):
        raise OutputError(f"cannot write {path!r}: it is a folder; give a file name")
    if extensions and target.suffix.lower() not in extensions:
        extensions_text = ", ".join(filter(None, extensions))
        raise InputError(f"{path!r} ends in {target.suffix or 'no suffix'}; choose from {extensions_text}")
    folder = target.parent
    if not os.path.isdir(folder) or not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write {path!r}: {str(folder)!r} is not a writable folder; create it first")
    files.require_writable(target)
    return target


@contextmanager
def output_folder(path: str | None) -> Generator[Path | None]:
    """Yield a folder for the files of a report, which appear in `path` together; None without a path.

    Raises:
        OutputError: before any computation, as `files.atomic_folder`.
    """
    if path is None:
        yield None
        return
    require_extra("pictures", "jinja2", "matplotlib", "mediapy")
    with files.atomic_folder(path) as unfinished:
        yield unfinished
