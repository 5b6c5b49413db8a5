function [u, x, z] = control_alssnn(model, x, z, r, y, d)
% One sample of the controller, whose states are x = zeros(model.lure.nx, 1) and
% z = zeros(size(model.K_z, 2), 1) at the start. r is a reference of y where there are
% integrators, else one of u; r and d must be finite. All are columns.
ny = numel(y);
every = model.u_offset;
moved = setdiff(1:numel(every), model.disturbances);
outputs = numel(x) + (1:ny);
seen = y;
measured = isfinite(y);
if ~isempty(model.gate)
    all_of = channels(model.lure, [x; zeros(size(every))]);
    expected = all_of(outputs) + model.y_offset;
    seen = min(max(y, expected - model.gate), expected + model.gate);
end
seen(~measured) = NaN;
x = correct_alssnn(model, x, every, seen);
if isempty(model.K_z)
    v = r - model.K_x * x;
else
    v = every(moved) - model.K_x * x - model.K_z * z;
end
if strcmp(model.feedback, 'output')
    all_of = channels(model.lure, [x; zeros(size(every))]);
    s = all_of(outputs) + model.y_offset;
    s(measured) = seen(measured);
else
    s = x(1:size(model.A, 1));
end
[u, cut] = law_alssnn(model, v, s, d);
if ~isempty(model.K_z)
    e = seen - r;
    e(~measured) = 0;
    z = z + e + pinv(model.K_z) * cut;
end
every(moved) = u;
every(model.disturbances) = d;
all_of = channels(model.lure, [x; every - model.u_offset]);
x = all_of(1:numel(x));
end
