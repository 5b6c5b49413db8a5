function x = correct_alssnn(model, x, u, y)
% Correct the predicted x by the measured y; u is the input of the same sample.
% What is not finite was not measured; an innovation counts as the gate at most.
z = channels(model.lure, [x; u - model.u_offset]);
e = y - z(numel(x) + (1:numel(y))) - model.y_offset;
e(~isfinite(e)) = 0;
if ~isempty(model.gate), e = min(max(e, -model.gate), model.gate); end
x = x + model.M * e;
end
