function [u, cut] = law_alssnn(model, v, s, d)
% Return the input that makes the model linear from v, within the limits, and what
% they cut off v. s is the measured y, or the estimate of x with state feedback; d are
% the measured disturbances, zeros(0, 1) without any. All are columns.
moved = setdiff(1:numel(model.u_offset), model.disturbances);
rest = model.u_offset(moved);
if strcmp(model.feedback, 'output'), s = s - model.y_offset; end
d = d - model.u_offset(model.disturbances);
dv = v - rest;
if ~isempty(model.law.middle), s = model.law.middle * [s; d; dv]; end
is_solved = ~isempty(model.law.phi);
if is_solved
    wanted = rest + solve_alssnn(model.law.phi, [s; d], dv, model.u_scale(moved));
else
    wanted = v - channels(model.law.h, [s; d]);
end
u = min(max(wanted, model.law.u_min), model.law.u_max);
cut = wanted - u;
if is_solved && any(cut ~= 0)  % phi couples inputs: a limit of one is one of all
    cut = dv - channels(model.law.phi, [s; d; u - rest]);
end
end
