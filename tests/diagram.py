"""Run a diagram of Simulink in Octave, by stand-ins of the functions that build it.

``add_block`` and ``add_line`` keep what they are given. They refuse what Simulink
refuses: a block or a port that is not there, and a second line into a port.
``run_diagram`` then evaluates the blocks at every sample, from the exits of the top
back to the unit delays.
"""

STAND_INS = {
    "new_system": """
function new_system(name)
global blocks sources top
top = name; blocks = struct(); sources = struct();
blocks = containers.Map(); sources = containers.Map();
end
""",
    "open_system": """
function open_system(name)
global top
assert(strcmp(name, top));
end
""",
    "add_block": """
function add_block(kind, path, varargin)
global blocks top
assert(~isKey(blocks, path));
folder = path(1:find(path == '/', 1, 'last') - 1);
assert(strcmp(folder, top) || strcmp(blocks(folder).kind, 'Subsystem'));
block = struct(varargin{:});
block.kind = strrep(kind, 'built-in/', '');
block.folder = folder;
block.number = 1;  % of entries and exits, in the order in which they came
for key = keys(blocks)
    other = blocks(key{1});
    if strcmp(other.folder, folder) && strcmp(other.kind, block.kind)
        block.number = block.number + 1;
    end
end
blocks(path) = block;
end
""",
    "add_line": """
function add_line(folder, from, to)
global blocks sources
assert(isKey(blocks, [folder '/' from(1:end - 2)]), from);
assert(isKey(blocks, [folder '/' to(1:end - 2)]), to);
key = [folder '/' to];
assert(~isKey(sources, key), key);
sources(key) = [folder '/' from];
end
""",
    "run_diagram": """
function [y, u] = run_diagram(varargin)
% Signals of the entries of the top, one sample per row; y and u are its exits.
global blocks sources top given state
state = containers.Map();
for key = keys(blocks)
    block = blocks(key{1});
    if strcmp(block.kind, 'UnitDelay')
        state(key{1}) = eval(block.InitialCondition);
    end
end
y = []; u = [];
for k = 1:rows(varargin{1})
    given = cellfun(@(s) s(k, :).', varargin, 'UniformOutput', false);
    known = containers.Map();
    y(k, :) = entering([top '/y/1'], known);
    if isKey(blocks, [top '/u']) && strcmp(blocks([top '/u']).kind, 'Outport')
        u(k, :) = entering([top '/u/1'], known);
    end
    after = containers.Map();
    for key = keys(state)
        after(key{1}) = entering([key{1} '/1'], known);
        assert(numel(after(key{1})) == numel(state(key{1})));
    end
    state = after;
end
end

function value = entering(port, known)
global sources
assert(isKey(sources, port), ['nothing enters ' port]);
value = leaving(sources(port), known);
end

function value = leaving(port, known)
% known is a handle: what one line has computed, all others have.
global blocks top given state
if isKey(known, port), value = known(port); return; end
path = port(1:end - 2); number = str2double(port(end)); block = blocks(path);
switch block.kind
case 'Inport'
    if strcmp(block.folder, top)
        value = given{block.number};
    else
        value = entering(sprintf('%s/%d', block.folder, block.number), known);
    end
case 'Subsystem'
    for key = keys(blocks)
        inner = blocks(key{1});
        is_port = strcmp(inner.folder, path) && strcmp(inner.kind, 'Outport');
        if is_port && inner.number == number
            value = entering([key{1} '/1'], known);
        end
    end
case 'UnitDelay'
    value = state(path);
case 'ZeroOrderHold'
    value = entering([path '/1'], known);
case 'Mux'
    sizes = eval(block.Inputs); value = [];
    for i = 1:numel(sizes)
        part = entering(sprintf('%s/%d', path, i), known);
        assert(numel(part) == sizes(i), path);
        value = [value; part];
    end
case 'Demux'
    whole = entering([path '/1'], known); sizes = eval(block.Outputs);
    assert(numel(whole) == sum(sizes), path);
    parts = mat2cell(whole, sizes); value = parts{number};
case 'Selector'
    whole = entering([path '/1'], known);
    assert(numel(whole) == str2double(block.InputPortWidth), path);
    value = whole(eval(block.Indices));
case 'MATLABFcn'
    f = str2func(['@(u) ' block.MATLABFcn]);
    value = f(entering([path '/1'], known));
    assert(numel(value) == str2double(block.OutputDimensions), path);
end
known(port) = value;
end
""",
}
