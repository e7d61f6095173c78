"""Lines of a world's own code that can make its runs differ, without running it.

The modules of its agents and services, its vocabulary and everything that they import from the same
folder or package are parsed. What comes from the arguments of a method, such as `moment.random`, is
never a suspect: only names that a module imports, and values whose kind its text shows.
"""

from __future__ import annotations

import ast
import importlib.util
import inspect
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from minerva_bus.launch.world_files import WorldFile
from minerva_bus.user_code import is_foreign
from minerva_determinism.layouts import left_out

MOST_LINES: Final = 10
"""Most lines of code that a text names."""

CLOCK: Final = "the time of day"
CHANCE: Final = "global random numbers"
SETS: Final = "the order of a set or of a folder"
IDENTITY: Final = "id() and hash() of this process"
SHARED: Final = "state of a module or a class, which each process has for itself"
FLOATS: Final = "floats that differ in the last bit between processors"
THREADS: Final = "threads and processes, which end in any order"
OUTSIDE: Final = "networks, files and settings of the machine"

OURS: Final = {"minerva_agents", "minerva_services", "minerva_worlds"}
"""Packages of the project, whose code no user changes, except that in the folder of the world."""

INSTEAD: Final[Mapping[str, str]] = {
    CLOCK: "moment.time; in a service tick.time",
    CHANCE: "moment.random, moment.chance; in a service tick.random",
    SETS: "sorted(...)",
    IDENTITY: "a number or a text of your own, such as self.id",
    SHARED: "attributes of the agent; in a service those that save returns",
    FLOATS: "minerva_bus.portable",
    THREADS: "results in an order of your own; a service that runs freely, which is not compared",
    OUTSIDE: "options of the world file; a service that runs freely, which is not compared",
}
"""The causes, and what to use instead of each."""

_NAMES: Final[Mapping[str, str]] = {
    CLOCK: """
        time.time time.time_ns time.monotonic time.monotonic_ns time.perf_counter
        time.perf_counter_ns time.process_time time.process_time_ns time.thread_time
        time.thread_time_ns time.clock_gettime time.clock_gettime_ns time.localtime time.gmtime
        time.ctime time.strftime time.asctime datetime.datetime.now datetime.datetime.utcnow
        datetime.datetime.today datetime.datetime.fromtimestamp datetime.date.today
        datetime.date.fromtimestamp pandas.Timestamp.now pandas.Timestamp.today
    """,
    CHANCE: """
        random.* numpy.random.* secrets.* os.urandom os.getrandom uuid.uuid1 uuid.uuid4
    """,
    SETS: "os.listdir os.scandir os.walk glob.glob glob.iglob",
    THREADS: """
        threading.Thread threading.Timer concurrent.futures.* multiprocessing.* asyncio.*
        _thread.start_new_thread numba.prange queue.Queue
    """,
    OUTSIDE: """
        socket.* ssl.* urllib.request.* http.client.* ftplib.* smtplib.* requests.* httpx.*
        aiohttp.* websockets.* subprocess.* platform.* locale.* os.environ os.environb os.getenv
        os.getpid os.getppid os.getcwd os.cpu_count os.stat os.system os.popen os.uname
        sys.argv sys.stdin open input pathlib.Path.cwd pathlib.Path.home
    """,
    FLOATS: """
        math.sin math.cos math.tan math.asin math.acos math.atan math.atan2 math.sinh math.cosh
        math.tanh math.asinh math.acosh math.atanh math.exp math.exp2 math.expm1 math.log math.log2
        math.log10 math.log1p math.pow math.cbrt math.gamma math.lgamma math.erf math.erfc cmath.*
        numpy.sin numpy.cos numpy.tan numpy.arcsin numpy.arccos numpy.arctan numpy.arctan2
        numpy.asin numpy.acos numpy.atan numpy.atan2 numpy.sinh numpy.cosh numpy.tanh numpy.arcsinh
        numpy.arccosh numpy.arctanh numpy.exp numpy.exp2 numpy.expm1 numpy.log numpy.log2
        numpy.log10 numpy.log1p numpy.logaddexp numpy.power numpy.float_power numpy.cbrt numpy.hypot
        numpy.angle numpy.dot numpy.vdot numpy.inner numpy.matmul numpy.einsum numpy.tensordot
        numpy.convolve numpy.correlate numpy.linalg.* numpy.fft.* scipy.*
    """,
    IDENTITY: "id hash",
}
_CAUSES: Final = {name: cause for cause, names in _NAMES.items() for name in names.split()}
"""The cause by the whole name; `package.*` stands for everything in it."""

_SEEDED: Final = frozenset({
    "random.Random", "numpy.random.default_rng", "numpy.random.RandomState",
    "numpy.random.SeedSequence", "numpy.random.PCG64", "numpy.random.Philox",
    "numpy.random.MT19937", "numpy.random.SFC64", "numpy.random.PCG64DXSM",
})  # fmt: skip
"""Streams of random numbers: they are global chance only without a seed."""
_HARMLESS: Final = _SEEDED | {
    "numpy.random.Generator", "numpy.random.BitGenerator", "concurrent.futures.Future",
    "subprocess.CompletedProcess", "subprocess.DEVNULL", "subprocess.PIPE",
}  # fmt: skip

_MAKES_SETS: Final = frozenset({"set", "frozenset"})
_SET_METHODS: Final = frozenset(
    {"union", "intersection", "difference", "symmetric_difference", "copy"}
)
_UNORDERED: Final = frozenset({"sorted", "set", "frozenset", "len", "min", "max", "any", "all"})
"""What takes a set without its order."""
_ORDERED: Final = frozenset(
    {"list", "tuple", "iter", "enumerate", "zip", "map", "filter", "reversed", "sum", "str", "repr",
     "math.fsum", "math.prod", "functools.reduce", "dict.fromkeys", "collections.deque",
     "itertools.chain", "itertools.islice", "itertools.accumulate", "itertools.cycle",
     "itertools.permutations", "itertools.combinations", "itertools.product",
     "numpy.array", "numpy.fromiter"}
)  # fmt: skip
"""What takes a set in its order."""
_FOLDER_METHODS: Final = frozenset({"iterdir", "glob", "rglob"})
_FILE_METHODS: Final = frozenset({"read_text", "read_bytes", "write_text", "write_bytes"})

_MAKES_STATE: Final = frozenset({
    "list", "dict", "set", "bytearray", "iter", "collections.Counter", "collections.defaultdict",
    "collections.deque", "collections.OrderedDict", "itertools.count", "itertools.cycle",
    "numpy.zeros", "numpy.ones", "numpy.empty", "numpy.full", "numpy.array", *_SEEDED,
})  # fmt: skip
_READS_STATE: Final = frozenset(
    {"get", "items", "keys", "values", "index", "count", "copy", "union", "intersection",
     "difference", "most_common"}
)  # fmt: skip
"""Methods that leave state as it is; all others change it, and those of a random stream do."""


@dataclass(frozen=True, slots=True, order=True)
class Suspect:
    """A line of code with a cause of differences; `code` is the part of the line."""

    file: str
    line: int
    cause: str
    code: str

    def plain(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self) | {"instead": INSTEAD[self.cause]}


def suspects(file: WorldFile) -> list[Suspect]:
    """The suspects in the code of a world, by file and line.

    Services that a comparison of runs leaves out are not examined.
    """
    omitted = left_out(file)
    classes: list[type] = [cls for process in file.processes for cls in process.agents]
    passed: set[tuple[str, str]] = set()
    for process in file.processes:
        if process.make_service is not None:
            cls = process.make_service.cls
            classes.append(cls)
            if process.name in omitted:
                passed.add((cls.__module__, cls.__qualname__))
    modules = {base.__module__ for cls in classes for base in cls.__mro__}
    listed: list[Suspect] = []
    for name, path, tree in _written(modules, file.path.parent.resolve()):
        classes_passed = {cls for module, cls in passed if module == name}
        with suppress(ValueError):
            path = path.relative_to(Path.cwd())
        listed += _Module(str(path), tree, classes_passed).suspects()
    return sorted(set(listed))


def causes(listed: Iterable[Suspect], *, same: bool = False) -> list[str]:
    """Suspects by cause, as text, with what to use instead; without any, the usual causes.

    `same`: no difference was found, so there is none to explain.
    """
    listed = list(listed)
    if not listed and same:
        return []
    if not listed:
        return ["usual causes, and what to use instead:"] + [
            f"  {cause}: {instead}" for cause, instead in INSTEAD.items()
        ]
    order = list(INSTEAD)
    listed.sort(key=lambda each: (order.index(each.cause), each))
    what = "lines that can make other runs differ" if same else "lines that can be the cause"
    shown = [f"{what}, and what to use instead:"]
    for cause, group in groupby(listed[:MOST_LINES], lambda each: each.cause):
        shown.append(f"  {cause}: {INSTEAD[cause]}")
        shown += [f"    {each.file}:{each.line}: {each.code}" for each in group]
    if more := len(listed) - MOST_LINES:
        shown += [f"  and {more} more; --json has all of them"] if more > 0 else []
    return shown


def _written(names: Iterable[str], folder: Path) -> Iterator[tuple[str, Path, ast.Module]]:
    """The modules of a world's own code, from those with these names on, parsed."""
    waiting, seen = sorted(names), set[str]()
    packages = {name.partition(".")[0] for name in waiting} - OURS
    while waiting:
        name = waiting.pop()
        path = None if name in seen else _source(name)
        seen.add(name)
        if path is None or (is_foreign(str(path)) and folder not in path.parents):
            continue
        # Its own: beside the world file, or in a package with agents or services of the world.
        if folder not in path.parents and name.partition(".")[0] not in packages:
            continue
        try:
            tree = ast.parse(path.read_bytes())
        except (OSError, SyntaxError, ValueError):
            continue
        yield name, path, tree
        package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        waiting += sorted(_imported(tree, package) - seen)


def _source(name: str) -> Path | None:
    """The file of a module in Python."""
    module = sys.modules.get(name)
    try:
        file = inspect.getsourcefile(module) if module is not None else None
        if module is None and (spec := importlib.util.find_spec(name)) is not None:
            file = spec.origin
    except (ImportError, TypeError, ValueError, AttributeError):
        return None
    return Path(file).resolve() if file and file.endswith(".py") else None


def _imported(tree: ast.Module, package: str) -> set[str]:
    """Whole names of the modules that a module imports, anywhere; some are names in modules."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")
                parents = parents[: len(parents) - node.level + 1]
                base = ".".join([*parents, *([base] if base else [])])
            names.update({base} if base else set())
            names.update(f"{base}.{alias.name}" for alias in node.names)
    return names


class _Module(ast.NodeVisitor):
    """Searches a module; classes with these names are passed over."""

    def __init__(self, path: str, tree: ast.Module, passed: Collection[str]) -> None:
        self._path, self._tree, self._passed = path, tree, passed
        self._found: list[Suspect] = []
        self._imports: dict[str, str] = {}
        self._sets: set[str] = set()
        self._state: set[str] = set()
        self._classes: set[str] = set()
        self._functions: list[dict[str, bool]] = []
        """The names that each enclosing function binds, and whether each is a set."""
        self._globals: set[str] = set()

    def suspects(self) -> list[Suspect]:
        """All suspects of the module."""
        for node in ast.walk(self._tree):
            self._learn_imports(node)
        assigned = self._bound(self._tree)
        self._sets |= {name for name, is_set in assigned.items() if is_set}
        for node in self._tree.body:
            self._learn_state(node)
            if isinstance(node, ast.ClassDef):
                self._classes.add(node.name)
                for inner in node.body:
                    self._learn_state(inner, f"{node.name}.", "self.", "cls.")
        # Those that a method assigns belong to each object.
        self._state -= {name for name in assigned if name.startswith("self.")}
        self.visit(self._tree)
        return self._found

    # --- what the names of the module stand for ---

    def _learn_imports(self, node: ast.AST) -> None:
        if isinstance(node, ast.Import):
            for alias in node.names:
                name = alias.name if alias.asname else alias.name.partition(".")[0]
                self._imports[alias.asname or name] = name
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            for alias in node.names:
                public: list[str] = getattr(sys.modules.get(node.module), "__all__", [])
                for name in public if alias.name == "*" else [alias.name]:
                    self._imports[alias.asname or name] = f"{node.module}.{name}"

    def _bound(self, scope: ast.AST) -> dict[str, bool]:
        """Names and attributes that a scope assigns, and whether all their values are sets."""
        sets: dict[str, bool] = {}
        for node in ast.walk(scope):
            if isinstance(node, ast.arg):
                sets[node.arg] = sets.get(node.arg, True) and _annotates_set(node.annotation)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                sets.setdefault(node.id, False)
        assigned: dict[str, bool] = {}
        for node in ast.walk(scope):
            if not isinstance(node, ast.Assign | ast.AnnAssign | ast.NamedExpr):
                continue
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            annotation = node.annotation if isinstance(node, ast.AnnAssign) else None
            is_set = self._is_set(node.value) or _annotates_set(annotation)
            for target in filter(None, map(_chain, targets)):
                assigned[target] = assigned.get(target, sets.get(target) is not True) and is_set
        return sets | assigned

    def _learn_state(self, node: ast.AST, *owners: str) -> None:
        """Values of a module or class that code can change."""
        # With an annotation, those of a class are attributes of each agent or object.
        if not isinstance(node, ast.Assign) and (owners or not isinstance(node, ast.AnnAssign)):
            return
        value = node.value
        made = isinstance(value, ast.Call) and self._name(value.func) in _MAKES_STATE
        if made or isinstance(
            value, ast.List | ast.Dict | ast.Set | ast.ListComp | ast.DictComp | ast.SetComp
        ):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in filter(None, map(_chain, targets)):
                self._state.update(f"{owner}{target}" for owner in owners or ("",))

    def _name(self, node: ast.expr) -> str:
        """The whole name that an expression stands for, by the imports; "" if it is none."""
        if isinstance(node, ast.Attribute):
            base = self._name(node.value)
            return f"{base}.{node.attr}" if base else ""
        if isinstance(node, ast.Name):
            if any(node.id in bound for bound in self._functions):
                return ""
            return self._imports.get(node.id, node.id)
        if isinstance(node, ast.Call):
            called = self._name(node.func)
            texts = [_text(argument) for argument in node.args]
            if called in ("__import__", "importlib.import_module") and texts:
                return texts[0]
            if called == "getattr" and len(texts) > 1 and texts[1]:
                base = self._name(node.args[0])
                return f"{base}.{texts[1]}" if base else ""
        return ""

    def _is_set(self, node: ast.expr | None) -> bool:
        if isinstance(node, ast.Set | ast.SetComp):
            return True
        if isinstance(node, ast.BinOp) and isinstance(
            node.op, ast.BitOr | ast.BitAnd | ast.Sub | ast.BitXor
        ):
            return any(self._is_set(side) or _is_keys(side) for side in (node.left, node.right))
        if isinstance(node, ast.IfExp):
            return self._is_set(node.body) or self._is_set(node.orelse)
        if isinstance(node, ast.BoolOp):
            return any(map(self._is_set, node.values))
        if isinstance(node, ast.Call):
            if isinstance(node.func, ast.Attribute) and node.func.attr in _SET_METHODS:
                return self._is_set(node.func.value)
            return self._name(node.func) in _MAKES_SETS
        chain = "" if node is None else _chain(node)
        scope = next((bound for bound in reversed(self._functions) if chain in bound), None)
        return chain in self._sets if scope is None or "." in chain else scope[chain]

    # --- the search ---

    def _add(self, node: ast.AST, cause: str) -> None:
        code = ast.unparse(node)
        code = code if len(code) <= 60 else f"{code[:57]}..."
        line: int = getattr(node, "lineno", 1)
        self._found.append(Suspect(self._path, line, cause, code))

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Pass over a service that is not compared."""
        if node.name not in self._passed:
            self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        """Search a function; its arguments hide names of the module."""
        arguments = node.args
        for default in (*arguments.defaults, *arguments.kw_defaults):
            if isinstance(default, ast.List | ast.Dict | ast.Set):
                self._add(default, SHARED)
        self._enter(node, arguments)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        """As any function."""
        self.visit_FunctionDef(node)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        """Search a function without a name."""
        self._enter(node, node.args)

    def _enter(self, node: ast.AST, arguments: ast.arguments) -> None:
        bound = self._bound(arguments) | self._bound(node)
        outer = self._globals
        self._globals = outer.union(
            *(inner.names for inner in ast.walk(node) if isinstance(inner, ast.Global))
        )
        self._functions.append(
            {name: is_set for name, is_set in bound.items() if name not in self._globals}
        )
        self.generic_visit(node)
        self._functions.pop()
        self._globals = outer

    def visit_Name(self, node: ast.Name) -> None:
        """A name of the module, or a change of one."""
        if isinstance(node.ctx, ast.Load):
            self._reference(node)
        elif node.id in self._globals:
            self._add(node, SHARED)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """A whole name, or a change of an attribute of a class."""
        if isinstance(node.ctx, ast.Store | ast.Del) and self._functions:
            if self._is_class(node.value):
                self._add(node, SHARED)
        elif not self._reference(node):
            self.generic_visit(node)

    def _is_class(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Name):
            hidden = any(node.id in bound for bound in self._functions)
            return node.id == "cls" or (node.id in self._classes and not hidden)
        if isinstance(node, ast.Call):
            return self._name(node.func) == "type" and len(node.args) == 1
        return isinstance(node, ast.Attribute) and node.attr == "__class__"

    def _reference(self, node: ast.expr) -> bool:
        """Whether an expression is a name with a cause, which is added."""
        cause = _cause(self._name(node))
        if cause:
            self._add(node, cause)
        return bool(cause)

    def visit_Call(self, node: ast.Call) -> None:
        """A call: of a name with a cause, of a method, or with a set."""
        name = self._name(node.func)
        named = _cause(name) or _cause(self._name(node))
        if cause := named or self._called(node, name):
            self._add(node, cause)
        parts: list[ast.AST] = [*node.args, *node.keywords]
        if name in _UNORDERED and node.args and self._passes_on(node.args[0]):
            self.generic_visit(parts.pop(0))
        for part in parts if named else [node.func, *parts]:
            self.visit(part)

    def _called(self, node: ast.Call, name: str) -> str:
        """The cause that a call is by its arguments, or ""."""
        values = [_value(each) for each in node.args]
        named = {each.arg: _value(each.value) for each in node.keywords}
        if name in _SEEDED and all(value is None for value in (*values, *named.values())):
            return CHANCE
        if name == "numpy.datetime64" and {"now", "today"} & {*map(_text, node.args)}:
            return CLOCK
        if name in _ORDERED and any(map(self._is_set, node.args)):
            return SETS
        if name == "next" and node.args and self._is_state(node.args[0]):
            return SHARED
        if named.get("parallel") is True:
            return THREADS
        return self._method(node, node.func) if isinstance(node.func, ast.Attribute) else ""

    def _method(self, node: ast.Call, method: ast.Attribute) -> str:
        called = method.attr
        if called == "pop" and not node.args and self._is_set(method.value):
            return SETS
        if called in ("join", "extend", "fromkeys") and any(map(self._is_set, node.args)):
            return SETS
        if called in _FILE_METHODS:
            return OUTSIDE
        if called in _FOLDER_METHODS:
            return SETS
        changes = called not in _READS_STATE and self._is_state(method.value)
        return SHARED if changes else ""

    def _is_state(self, node: ast.expr) -> bool:
        """Whether it is state of a module or class, in a function."""
        chain = _chain(node)
        root = chain.partition(".")[0]
        hidden = root not in ("self", "cls") and any(root in bound for bound in self._functions)
        return bool(self._functions) and not hidden and chain in self._state

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """A change of an item."""
        if isinstance(node.ctx, ast.Store | ast.Del) and self._is_state(node.value):
            self._add(node, SHARED)
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """A change in place."""
        if not isinstance(node.target, ast.Subscript) and self._is_state(node.target):
            self._add(node, SHARED)
        if isinstance(node.op, ast.MatMult) or _is_root(node.op, node.value):
            self._add(node, FLOATS)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """A product of matrices, or a root."""
        if isinstance(node.op, ast.MatMult) or _is_root(node.op, node.right):
            self._add(node, FLOATS)
        self.generic_visit(node)

    def visit_For(self, node: ast.For) -> None:
        """A loop over a set."""
        if self._is_set(node.iter):
            self._add(node.iter, SETS)
        self.generic_visit(node)

    def visit_Starred(self, node: ast.Starred) -> None:
        """A set in its order."""
        if self._is_set(node.value):
            self._add(node, SETS)
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """A set that is taken apart."""
        if self._is_set(node.value) and any(isinstance(each, ast.Tuple) for each in node.targets):
            self._add(node, SETS)
        self.generic_visit(node)

    def visit_YieldFrom(self, node: ast.YieldFrom) -> None:
        """A set in its order."""
        if self._is_set(node.value):
            self._add(node, SETS)
        self.generic_visit(node)

    def visit_ListComp(self, node: ast.ListComp) -> None:
        """A list in the order of a set."""
        self._comprehension(node)

    def visit_GeneratorExp(self, node: ast.GeneratorExp) -> None:
        """Items in the order of a set."""
        self._comprehension(node)

    def visit_DictComp(self, node: ast.DictComp) -> None:
        """A dict in the order of a set."""
        self._comprehension(node)

    def _comprehension(self, node: ast.ListComp | ast.GeneratorExp | ast.DictComp) -> None:
        for each in node.generators:
            if self._is_set(each.iter):
                self._add(each.iter, SETS)
        self.generic_visit(node)

    def _passes_on(self, node: ast.expr) -> bool:
        """Whether it has the items of another value, in the order of that."""
        if isinstance(node, ast.Call):
            return self._name(node.func) in ("map", "filter", "list", "tuple")
        return isinstance(node, ast.GeneratorExp | ast.ListComp)


def _cause(name: str) -> str:
    """The cause that a whole name is, or ""."""
    if name in _HARMLESS or name.endswith(("Error", "Exception")):
        return ""
    package, parts = name, name.count(".")
    cause = _CAUSES.get(name, "")
    for _ in range(parts):
        package = package.rpartition(".")[0]
        cause = cause or _CAUSES.get(f"{package}.*", "")
    return cause


def _chain(node: ast.AST) -> str:
    """Names with points between them, or ""."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        base = _chain(node.value)
        return f"{base}.{node.attr}" if base else ""
    return ""


def _text(node: ast.expr) -> str:
    value = _value(node)
    return value if isinstance(value, str) else ""


def _value(node: ast.expr) -> Any:
    """The value of a constant; any other expression is itself."""
    return node.value if isinstance(node, ast.Constant) else node


def _is_keys(node: ast.expr) -> bool:
    """Whether it is `x.keys()`, whose differences and unions are sets."""
    method = node.func if isinstance(node, ast.Call) else None
    return isinstance(method, ast.Attribute) and method.attr in ("keys", "items")


def _is_root(operator: ast.operator, exponent: ast.expr) -> bool:
    value = _value(exponent)
    return isinstance(operator, ast.Pow) and isinstance(value, float) and not value.is_integer()


def _annotates_set(annotation: ast.expr | None) -> bool:
    if isinstance(annotation, ast.Subscript):
        annotation = annotation.value
    names = ("set", "frozenset", "Set", "FrozenSet", "MutableSet", "AbstractSet")
    return annotation is not None and _chain(annotation).rpartition(".")[2] in names
