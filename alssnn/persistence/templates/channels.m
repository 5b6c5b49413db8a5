function [z, J, extent] = channels(form, xu)
% Evaluate the rows of a Lur'e form on a column [x; du].
% J is their derivative, and extent the size of what they are sums of.
w = zeros(size(form.V, 1), 1);
S = zeros(size(form.V));
for i = 1:numel(form.layers)
    layer = form.layers(i);
    j = layer.first:layer.last;
    value = str2func(['@(v) ' layer.value]);
    v = form.V(j, :) * xu + form.E(j, :) * w + form.b(j);
    w(j) = value(v);
    if nargout > 1
        slope = str2func(['@(v, w) ' layer.slope]);
        rise = repmat(slope(v, w(j)), 1, numel(xu));
        S(j, :) = rise .* (form.V(j, :) + form.E(j, :) * S);
    end
end
z = form.M * xu + form.W * w + form.c;
J = form.M + form.W * S;
extent = abs(form.M) * abs(xu) + abs(form.W) * abs(w) + abs(form.c);
end
