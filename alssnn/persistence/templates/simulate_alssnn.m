function y = simulate_alssnn(model, u)
% Simulate u (N, nu) to y (N, ny), time running down the rows.
% load pump.mat; y = simulate_alssnn(model, u);
x = zeros(model.lure.nx, 1);
y = zeros(size(u, 1), numel(model.y_offset));
for k = 1:size(u, 1)
    z = channels(model.lure, [x; u(k, :).' - model.u_offset]);
    x = z(1:numel(x));
    y(k, :) = (z(numel(x) + (1:size(y, 2))) + model.y_offset).';
end
end
